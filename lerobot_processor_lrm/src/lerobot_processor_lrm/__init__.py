"""A LeRobot action step that commands a calibrated arm."""

from lerobot_processor_lrm.compensation import Compensation

try:
    from lerobot_processor_lrm.step import CalibratedActionStep
except ImportError:  # without LeRobot the mathematics alone
    __all__ = ["Compensation"]
else:
    __all__ = ["CalibratedActionStep", "Compensation"]
