"""Calibrated robots for LeRobot: `--robot.type=so101_follower_calibrated --robot.model=model.toml`.

LeRobot imports this module by its name, which registers a calibrated form of every robot, and the processor steps
`lrm_calibrated_action` and `lrm_calibrated_observation`. Without LeRobot it is the mathematics alone: `Correction`.
"""

from importlib.util import find_spec

from lerobot_robot_lrm.correction import Correction
from lrm_math.kinematics.motion import Motion

__all__ = ["Correction", "Motion"]

if find_spec("lerobot") is not None:
    from lerobot_robot_lrm.calibrated_pair import CalibratedPair
    from lerobot_robot_lrm.calibrated_robot import CalibratedRobot
    from lerobot_robot_lrm.pipelines import calibrated_processors
    from lerobot_robot_lrm.processor import CalibratedAction, CalibratedObservation
    from lerobot_robot_lrm.registration import CalibratedForm, CalibratedPairForm, register_calibrated_robots
    from lrm_math.arm.lerobot_late_replies import drop_late_replies
    from lrm_math.arm.lerobot_torque_on import torque_on_where_they_stand

    __all__ += ["CalibratedAction", "CalibratedForm", "CalibratedObservation", "CalibratedPair"]
    __all__ += ["CalibratedPairForm", "CalibratedRobot", "calibrated_processors", "drop_late_replies"]
    __all__ += ["torque_on_where_they_stand"]
    register_calibrated_robots()
