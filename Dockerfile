# An installed ROS 2 Jazzy with the five packages, built by colcon. Not built by the
# project's tests. Build it from a fresh clone, since all files are copied.
#
#   docker build -t pa_ros .
#   docker run --rm -it pa_ros pa_ros launch
FROM ros:jazzy-ros-base

RUN apt-get update && apt-get install -y --no-install-recommends \
      build-essential cmake python3-colcon-common-extensions python3-venv \
      ros-jazzy-control-msgs ros-jazzy-simulation-interfaces ros-jazzy-vision-msgs \
    && rm -rf /var/lib/apt/lists/*

# Jazzy's messages are compiled for NumPy 1, so the exact versions of constraints.txt do not apply.
RUN python3 -m venv --system-site-packages /opt/venv \
    && touch /opt/venv/COLCON_IGNORE \
    && /opt/venv/bin/pip install --no-cache-dir \
      "numpy<2" argcomplete gymnasium matplotlib mcap mujoco nanobind Pillow pydantic PyYAML \
      "rich>=13.3.3" rosbags safetensors torch

COPY . /src
WORKDIR /src
RUN . /opt/ros/jazzy/setup.sh && . /opt/venv/bin/activate \
    && colcon build --merge-install --install-base /opt/pa_ros --paths msgs_schema pa_ros *_node \
      --cmake-args -DCMAKE_BUILD_TYPE=Release -DPython3_EXECUTABLE=/opt/venv/bin/python3

SHELL ["/bin/bash", "-c"]
ENTRYPOINT ["/bin/bash", "-c", "source /opt/venv/bin/activate && source /opt/pa_ros/setup.bash && exec \"$@\"", "--"]
CMD ["pa_ros", "launch"]
