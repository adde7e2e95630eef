"""Libraries and compiled kernels that all local workers share; importing this module loads them."""

import importlib

from armgate.control import compiled as control
from armgate.gate.clearance import compiled as gate

for _name in ("numpy", "pinocchio", "coal", "fcl", "armgate.campaign.laboratory"):
    importlib.import_module(_name)
if gate.available():
    gate.prepare()
control.prepare()
