"""OpenCV, which only the camera's commands need."""

from __future__ import annotations

from types import ModuleType

from lrm_math.errors import LrmError


def opencv() -> ModuleType:
    """The package cv2. Raises `LrmError` if it is not installed, or its version has no ChArUco detector."""
    try:
        import cv2
    except ImportError:
        raise LrmError("a camera needs OpenCV; pip install 'lrm-arm[camera]'") from None
    if not hasattr(cv2, "aruco") or not hasattr(cv2, "calibrateRobotWorldHandEye"):
        raise LrmError(f"OpenCV {cv2.__version__} lacks what is needed; pip install 'lrm-arm[camera]' (4.13)")
    return cv2
