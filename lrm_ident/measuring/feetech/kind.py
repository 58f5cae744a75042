"""Feetech STS servos as a bus knows them."""

from __future__ import annotations

from lrm_ident.measuring.feetech import memory_table as table
from lrm_ident.measuring.feetech.packets import FeetechPacket
from lrm_ident.measuring.servo_bus.kind import BusServoKind

FEETECH = BusServoKind(
    prefix="feetech:",
    packet=FeetechPacket,
    baud=1_000_000,
    models={table.MODEL_STS3215: "STS3215", table.MODEL_STS3250: "STS3250"},
    modes=(0,),
    last_read=table.LAST_READ,
    model=table.MODEL,
    mode=table.MODE,
    least=table.MIN_POSITION,
    greatest=table.MAX_POSITION,
    torque=table.TORQUE_ENABLE,
    goal=table.GOAL_POSITION,
    position=table.POSITION,
    temperature=table.TEMPERATURE,
    limit=table.TORQUE_LIMIT,
    most=table.MAX_TORQUE,
)
