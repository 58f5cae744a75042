"""Texts of the types that `rosbags` does not have: `std_srvs/Trigger`, and the action `FollowJointTrajectory`.

An action is three services and two topics (design.ros2.org/articles/actions.html); their types are made of its goal,
result and feedback as `rosidl` makes them.
"""

from __future__ import annotations

TRIGGER = "std_srvs/srv/Trigger"
CANCEL_GOAL = "action_msgs/srv/CancelGoal"
ACTION = "control_msgs/action/FollowJointTrajectory"
SEND_GOAL, GET_RESULT, FEEDBACK = f"{ACTION}_SendGoal", f"{ACTION}_GetResult", f"{ACTION}_FeedbackMessage"
STATUS = "action_msgs/msg/GoalStatusArray"
SERVICES = (TRIGGER, CANCEL_GOAL, SEND_GOAL, GET_RESULT)
EMPTY = "uint8 structure_needs_at_least_one_member"
"""Field that `rosidl` puts into a message without any."""
UUID = "unique_identifier_msgs/msg/UUID goal_id"
POINT = "trajectory_msgs/msg/JointTrajectoryPoint"
BODY_POINT = "trajectory_msgs/msg/MultiDOFJointTrajectoryPoint"


def action_texts(action: str, goal: str, result: str, feedback: str) -> dict[str, str]:
    """The messages of an action's services and topics, from those of its goal, result and feedback."""
    return {
        f"{action}_Goal": goal,
        f"{action}_Result": result,
        f"{action}_Feedback": feedback,
        f"{action}_SendGoal_Request": f"{UUID}\n{action}_Goal goal",
        f"{action}_SendGoal_Response": "bool accepted\nbuiltin_interfaces/msg/Time stamp",
        f"{action}_GetResult_Request": UUID,
        f"{action}_GetResult_Response": f"int8 status\n{action}_Result result",
        f"{action}_FeedbackMessage": f"{UUID}\n{action}_Feedback feedback",
    }


TEXTS = {
    f"{TRIGGER}_Request": EMPTY,
    f"{TRIGGER}_Response": "bool success\nstring message",
    f"{CANCEL_GOAL}_Request": "action_msgs/msg/GoalInfo goal_info",
    f"{CANCEL_GOAL}_Response": "int8 return_code\naction_msgs/msg/GoalInfo[] goals_canceling",
    "control_msgs/msg/JointTolerance": "string name\nfloat64 position\nfloat64 velocity\nfloat64 acceleration",
    "control_msgs/msg/JointComponentTolerance": (
        "string joint_name\nuint16 component\nfloat64 position\nfloat64 velocity\nfloat64 acceleration"
    ),
    **action_texts(
        ACTION,
        "trajectory_msgs/msg/JointTrajectory trajectory\n"
        "trajectory_msgs/msg/MultiDOFJointTrajectory multi_dof_trajectory\n"
        "control_msgs/msg/JointTolerance[] path_tolerance\n"
        "control_msgs/msg/JointComponentTolerance[] component_path_tolerance\n"
        "control_msgs/msg/JointTolerance[] goal_tolerance\n"
        "control_msgs/msg/JointComponentTolerance[] component_goal_tolerance\n"
        "builtin_interfaces/msg/Duration goal_time_tolerance",
        "int32 error_code\nstring error_string",
        "std_msgs/msg/Header header\nstring[] joint_names\n"
        f"{POINT} desired\n{POINT} actual\n{POINT} error\nstring[] multi_dof_joint_names\n"
        f"{BODY_POINT} multi_dof_desired\n{BODY_POINT} multi_dof_actual\n{BODY_POINT} multi_dof_error",
    ),
}
