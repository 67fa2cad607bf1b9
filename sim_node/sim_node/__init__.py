"""Shell that puts the arena on the graph: topics and services to `pa_ros.arena`."""
