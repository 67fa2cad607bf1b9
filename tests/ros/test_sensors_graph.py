"""What drivers of other people publish is heard, with best effort or reliably, and once."""

import pytest

from pa_ros.ros import topics
from pa_ros.ros.executor import spin_until
from pa_ros.ros.topics import best_effort
from pa_ros.tools.client import client_node

SENSORS = (
    topics.JOINT_STATES,
    topics.TF,
    topics.DETECTIONS,
    topics.CAMERA_IMAGE,
    topics.CAMERA_INFO,
    topics.tracked_pose("pose"),
)


@pytest.mark.graph
@pytest.mark.parametrize("topic", SENSORS, ids=lambda topic: topic.name)
def test_every_publisher_of_a_sensor_is_heard_once(topic):
    heard: list[object] = []
    with client_node("reader") as node, client_node("driver") as driver:
        topic.subscribe(node, heard.append)
        qualities = topics.STEP, best_effort(topics.STEP), best_effort(topics.STEP)
        makers = [driver.create_publisher(topic.type, topic.name, qos) for qos in qualities]
        assert spin_until(node, lambda: all(one.get_subscription_count() for one in makers), 30)
        sent = 0
        for publisher in makers:
            before = len(heard)
            for _ in range(50):  # the reader may match a little later than the publisher
                publisher.publish(topic.type())
                sent += 1
                if spin_until(node, lambda: len(heard) > before, 0.3):  # noqa: B023
                    break
            else:
                pytest.fail(f"{publisher} is not heard")
        assert not spin_until(node, lambda: len(heard) > sent, 0.3), "heard twice"
