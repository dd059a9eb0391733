"""The real ROS 2 of the tests: nodes of two processes hear each other, and types have our hashes."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from firstfix.ros.type_hashes import TYPE_HASHES
from tests.claimed import any_domain
from tests.robots.real_ros import DISTRIBUTIONS, real_ros

pytestmark = pytest.mark.slow

SERVER = """
import rclpy, sys, threading
from std_srvs.srv import Trigger
def answer(request, response):
    response.success, response.message = True, "here"
    return response
rclpy.init()
node = rclpy.create_node("server")
node.create_service(Trigger, "ask", answer)
threading.Thread(target=lambda: (sys.stdin.read(), rclpy.shutdown()), daemon=True).start()
rclpy.spin(node)
"""
CLIENT = """
import rclpy
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage
import firstfix_client, numpy
rclpy.init()
node = rclpy.create_node("client")
client = node.create_client(Trigger, "ask")
assert client.wait_for_service(200)
future = client.call_async(Trigger.Request())
rclpy.spin_until_future_complete(node, future)
node.create_publisher(TFMessage, "tf", 1).publish(TFMessage())
print(future.result().message)
"""


@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
def test_two_processes_hear_each_other(distribution: str, tmp_path: Path):
    ros = real_ros(distribution)
    environment = ros.environment(any_domain(), {"ROS_LOG_DIR": str(tmp_path)})
    with subprocess.Popen([ros.python, "-c", SERVER], env=environment, stdin=subprocess.PIPE) as server:
        assert server.stdin is not None
        # The one has ROS alone, the other is the tests' own Python with ROS beside it.
        client = subprocess.run(
            [sys.executable, "-c", CLIENT], env=environment, capture_output=True, text=True, check=False
        )
        server.stdin.close()
    assert client.stdout == "here\n", client.stderr


@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
def test_types_have_the_hashes_that_we_tell(distribution: str):
    told = {}
    for description in real_ros(distribution).prefix.glob("share/*/*/*.json"):
        content = json.loads(description.read_text())
        told |= {one["type_name"]: one["hash_string"] for one in content.get("type_hashes", [])}
    assert TYPE_HASHES.items() <= told.items()
