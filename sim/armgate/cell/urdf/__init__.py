"""Strict reading and composing of robot descriptions (URDF): anything not supported is refused by name.

Supported are trees of ``revolute``, ``prismatic`` and ``fixed`` joints, and collision bodies of
``<sphere radius>``, ``<box size>``, ``<cylinder radius length>`` and, beyond the standard,
``<capsule radius length>`` (length without its caps, axis along z), ``<cone radius length>`` (tip at
+length/2) and ``<convex vertices radius>`` (hull of the points "x y z x y z …", thickened). A ``<mesh>`` is
cut into ``<convex>`` bodies first (``meshes``), so the composed text needs no other files. ``vocabulary``
lists the elements and attributes that are read or ignored; all others are refused. All errors of a
description are reported together.
"""

from armgate.cell.urdf.description import Urdf, UrdfBody, UrdfJoint
from armgate.cell.urdf.elements import MAX_NUMBER
from armgate.cell.urdf.reader import read_robot, read_urdf
from armgate.cell.urdf.xml_tree import parse_xml

__all__ = ["MAX_NUMBER", "Urdf", "UrdfBody", "UrdfJoint", "parse_xml", "read_robot", "read_urdf"]
