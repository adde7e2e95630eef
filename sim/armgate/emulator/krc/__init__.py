"""A virtual KRC: the robot's side of KUKA's Robot Sensor Interface, as unforgiving as the real one.

``controller`` is the KRC without time and sockets; ``station`` runs it by the wall clock over UDP. Angles are
in deg and lengths in mm throughout, as on the controller that it stands for.
"""

from armgate.emulator.krc.arm import Arm, Axis, kr16
from armgate.emulator.krc.context import Context, Limits, Mode
from armgate.emulator.krc.controller import Controller
from armgate.emulator.krc.errors import KrcError
from armgate.emulator.krc.ethernet import Ethernet, read_ethernet
from armgate.emulator.krc.inbox import Arrival
from armgate.emulator.krc.machine import Event, State
from armgate.emulator.krc.notes import Notes
from armgate.emulator.krc.profile import PROFILES, Profile, profile_named

__all__ = [
    "PROFILES",
    "Arm",
    "Arrival",
    "Axis",
    "Context",
    "Controller",
    "Ethernet",
    "Event",
    "KrcError",
    "Limits",
    "Mode",
    "Notes",
    "Profile",
    "State",
    "kr16",
    "profile_named",
    "read_ethernet",
]
