"""Virtual KRC: the robot's side of KUKA's Robot Sensor Interface (RSI), as strict as the real one.

``controller`` is the KRC without time and sockets; ``process.real_time`` runs it by the wall clock over UDP.
Angles are in deg and lengths in mm throughout, as on a real controller.
"""

from armgate.emulator.krc.context import Context, Limits, Mode
from armgate.emulator.krc.controller import Controller
from armgate.emulator.krc.errors import KrcError
from armgate.emulator.krc.log import EventLog
from armgate.emulator.krc.profile import PROFILES, Profile, profile_named
from armgate.emulator.krc.robot.arm import Arm, Axis, kr16
from armgate.emulator.krc.rsi.ethernet import Ethernet
from armgate.emulator.krc.rsi.ethernet_file import read_ethernet
from armgate.emulator.krc.rsi.reply_filter import Arrival
from armgate.emulator.krc.states import Event, State

__all__ = [
    "PROFILES",
    "Arm",
    "Arrival",
    "Axis",
    "Context",
    "Controller",
    "Ethernet",
    "Event",
    "EventLog",
    "KrcError",
    "Limits",
    "Mode",
    "Profile",
    "State",
    "kr16",
    "profile_named",
    "read_ethernet",
]
