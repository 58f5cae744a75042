"""Modules that write to a motor and are held to the laws by other tests: each with the folder or file that does it.

A door that registers (`tests/doors/NAME_door.py`) takes its modules from here.
"""

ELSEWHERE = {
    "lrm_skills.behaviours": "tests/skills/test_state_machines.py",
    "lrm_skills.rafcon_library": "tests/skills/test_state_machines.py",
    "lrmd.api.router_process": "tests/system/test_estop_path.py",
    "lrmd.cli.clock_calibration": "tests/daemon/cli/test_servo_calibration.py",
    "lrmd.cli.motion": "tests/daemon/cli/test_lrm_cli.py",
    "lrmd.cli.servo_calibration": "tests/daemon/cli/test_servo_calibration.py",
    "lrmd.cli.skill": "tests/daemon/cli/test_lrm_cli.py",
    "lrmd.demo": "tests/system/test_demo.py",
    "lrmd.link.serial_port": "tests/daemon/ramp",
}
