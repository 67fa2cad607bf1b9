"""Binding of the fused engine (pa_ros/native): one DPG update on the CPU, and acting."""
