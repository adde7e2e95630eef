"""Libraries and compiled kernels that all local workers share; importing this module loads them."""

import importlib

from armgate import gate
from armgate.cell.compilation import announced
from armgate.control import compiled as control

for _name in ("numpy", "pinocchio", "coal", "fcl", "armgate.campaign.laboratory"):
    importlib.import_module(_name)
with announced():
    gate.prepare()
    control.prepare()
