"""Start arguments of the ramp process, made from the daemon's configuration."""

from __future__ import annotations

from lrmd.config import MS, Config
from lrmd.ramp.board_settings import BoardSettings, ServoOutput
from lrmd.ramp.process import RampSetup
from lrmd.ramp.shared_fd import SharedFd


def board_settings(config: Config, speed: float = 1.0) -> BoardSettings:
    """Settings of the board, for a clock that runs at `speed` times real time."""
    return BoardSettings(
        servos=tuple(ServoOutput(servo.channel, servo.lowest, servo.highest) for servo in config.servos),
        prescale=config.clock.prescale, count_s=config.clock.count_s, step=config.step, reply=config.reply,
        pause=config.link.silence_ms * MS // 2, silence_ms=config.link.silence_ms, simulated=speed != 1.0,
    )  # fmt: skip


def ramp_setup(config: Config, speed: float, memory: SharedFd, estop: SharedFd) -> RampSetup:
    """All of them. `speed`: ratio of a simulated board's clock to real time."""
    return RampSetup(
        board_settings(config, speed), config.link.port, config.link.baud, config.tick, config.realtime_priority, speed,
        memory, estop,
    )  # fmt: skip
