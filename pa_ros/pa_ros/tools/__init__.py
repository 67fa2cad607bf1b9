"""What people start on the graph: launching, watching, sending, recording, playback."""
