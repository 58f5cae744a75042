"""Command line of the bridge, `lrm-ros2`."""

from __future__ import annotations

import argparse
import signal
import sys
import threading

from lrm_math.command_line import OneLineParser
from lrm_math.errors import LrmError
from lrm_ros2.action import FollowAction
from lrm_ros2.action_types import CANCEL_GOAL, GET_RESULT, SEND_GOAL, TRIGGER
from lrm_ros2.arrivals import Arrivals
from lrm_ros2.bridge import TrajectoryDoor, publish_states, stop_service
from lrm_ros2.message_types import DISTRIBUTIONS
from lrm_ros2.ros_node import ACTION_NAME, TOPIC_NAME, RosNetwork, RosNode
from lrm_ros2.sender_watch import SenderEnd, SenderWatch
from lrmd.client import Rover

TEXT = """\
Bridge between the daemon lrmd and ROS 2 over rmw_zenoh, without ROS installed: /lrm/joint_states and /diagnostics out,
services /lrm/hold and /lrm/estop (std_srvs/Trigger), and with --trajectories /lrm/joint_trajectory
(trajectory_msgs/JointTrajectory) and the action /lrm/follow_joint_trajectory in. The arm must be armed; the bridge
never arms it. Ctrl-C, and the loss of an action's client, end a motion in hold.
"""


def main(argv: list[str] | None = None) -> int:
    """Runs the bridge until SIGTERM or Ctrl-C. Exit code 0 then, 2 if it cannot begin."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        _run(_parser().parse_args(argv))
    except KeyboardInterrupt:
        return 0
    except LrmError as error:
        print(f"lrm-ros2: {error}", file=sys.stderr)
        return 2
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = OneLineParser("lrm-ros2", description=TEXT)
    parser.add_argument("--robot", default="rover", help="whose daemon")
    parser.add_argument("--connect", metavar="ENDPOINTS", help="of the daemon; default LRM_CONNECT or this machine")
    parser.add_argument("--ros-router", default="127.0.0.1:7447", metavar="HOST:PORT", help="zenoh router of ROS 2")
    parser.add_argument("--distribution", choices=DISTRIBUTIONS, default="jazzy", help="of ROS 2")
    parser.add_argument("--domain", type=int, default=0, help="ROS_DOMAIN_ID")
    parser.add_argument("--namespace", default="/lrm", help="of the topics; default /lrm")
    parser.add_argument("--trajectories", action="store_true", help="follow trajectories; without it nothing moves")
    return parser


def _open_stops(node: RosNode, door: TrajectoryDoor) -> None:
    rover = door.rover
    node.serve("hold", TRIGGER, stop_service(lambda: door.stop(rover.hold), "the arm holds"), stops=True)
    node.serve("estop", TRIGGER, stop_service(lambda: rover.estop("ROS 2"), "all pulses are off"), stops=True)


def _open_orders(node: RosNode, door: TrajectoryDoor, action: FollowAction) -> None:
    def heard(token: str, there: bool) -> None:
        """A liveliness token of ROS comes, or goes."""
        door.senders.token(token, there)
        action.client(token, there)

    node.watch_tokens(heard)
    node.take_trajectories(door.take)
    node.serve(f"{ACTION_NAME}/send_goal", SEND_GOAL, action.send_goal)
    node.serve(f"{ACTION_NAME}/cancel_goal", CANCEL_GOAL, action.cancel_goal)
    node.serve(f"{ACTION_NAME}/get_result", GET_RESULT, action.get_result)


def _run(options: argparse.Namespace) -> None:
    host, _, port = options.ros_router.rpartition(":")
    if not host or not port.isdecimal():
        raise LrmError(f"--ros-router {options.ros_router}: should be like 127.0.0.1:7447")
    network = RosNetwork(host, int(port), options.distribution, options.domain)
    with Rover(options.robot, options.connect.split(",") if options.connect else None) as rover:
        rover.info()
        arrivals, ended = Arrivals(), threading.Event()
        with RosNode(network, options.namespace, arrivals) as node, arrivals:
            topic = SenderEnd("MP", f"{options.namespace.rstrip('/')}/{TOPIC_NAME}")
            clients = SenderEnd("SC", f"{options.namespace.rstrip('/')}/{ACTION_NAME}/send_goal")
            senders = SenderWatch(node.ask_session, (topic, clients))
            door = TrajectoryDoor(rover, arrivals, senders, topic)
            action = FollowAction(door, node, clients)
            _open_stops(node, door)
            if options.trajectories:
                _open_orders(node, door, action)
            print(f"bridge of {rover.robot} to ROS 2 at {options.ros_router}", flush=True)
            threads = [
                threading.Thread(target=publish_states, args=(rover, node, door, action.on_state, ended)),
                threading.Thread(target=senders.run, args=(ended,)),
            ]
            for thread in threads:
                thread.start()
            try:
                while True:
                    door.follow_next(0.2)
            finally:
                ended.set()
                for thread in threads:
                    thread.join()
