"""Dynamixel X servos as a bus knows them."""

from __future__ import annotations

from lrm_ident.measuring.dynamixel import memory_table as table
from lrm_ident.measuring.dynamixel.packets import DynamixelPacket
from lrm_ident.measuring.servo_bus.kind import BusServoKind

DYNAMIXEL = BusServoKind(
    prefix="dynamixel:",
    packet=DynamixelPacket,
    baud=1_000_000,
    models=table.MODELS,
    modes=(table.POSITION_MODE, table.CURRENT_POSITION_MODE),
    last_read=table.SIZE,
    model=table.MODEL,
    mode=table.OPERATING_MODE,
    least=table.MIN_POSITION,
    greatest=table.MAX_POSITION,
    torque=table.TORQUE_ENABLE,
    goal=table.GOAL_POSITION,
    position=table.POSITION,
    temperature=table.TEMPERATURE,
    limit=table.GOAL_PWM,
    most=table.PWM_LIMIT,
)
