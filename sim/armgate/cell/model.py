"""Kinematics of one robot: pinocchio's model, built from the strictly read URDF.

This is the only module of the package that calls pinocchio. Results are in the world frame: they include the
placement of the robot's base. A model keeps pinocchio's workspace, so it must not be used by two threads at
once.
"""

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from armgate.cell.errors import ModelError
from armgate.cell.placement import Placement
from armgate.cell.shapes import Shape
from armgate.cell.urdf import Urdf, read_urdf
from armgate.cell.urdf.normalize import kinematics_only

Array = NDArray[np.float64]

MAX_JOINTS = 64
"""Largest number of moving joints of a robot: the protocol describes no more."""


@dataclass(frozen=True)
class Joint:
    """Moving joint with its limits from the URDF in rad or m, per s and per s²; inf: no such limit."""

    name: str
    kind: Literal["revolute", "prismatic"]
    lower: float
    upper: float
    velocity: float
    acceleration: float = math.inf
    deceleration: float = math.inf


@dataclass(frozen=True)
class ModelBody:
    """Body of a robot.

    Attributes:
        name: Name, unique in the robot.
        link: Name of the link to which it is fixed.
        joint: Index of the joint that moves the link, -1 for the base.
        shape: Shape of the body.
        placement: Placement in the frame of that joint; in the world for the base.
    """

    name: str
    link: str
    joint: int
    shape: Shape
    placement: Placement


@dataclass(frozen=True)
class _Frame:
    joint: int
    placement: Placement


def _frozen(values: ArrayLike, dtype: Any = np.float64) -> NDArray[Any]:
    array = np.array(values, dtype=dtype)
    array.setflags(write=False)
    return array


class RobotModel:
    """Robot with ``n`` joints: placements and Jacobians of its frames and bodies.

    Attributes:
        n: Number of joints.
        joints: Joints in the order of q.
        lower: Lower limits, (n,), read-only, rad or m.
        upper: Upper limits, (n,), read-only, rad or m.
        velocity: Largest speeds, (n,), read-only, rad/s or m/s.
        base: Placement of the base in the world.
        bodies: Bodies in the order of the URDF's links.
        frame_names: Names of the links; each has a frame.
        parents: Index of each joint's parent joint, -1 for the base.
        chain: True for each joint that moves a body, (bodies, n), bool, read-only.
        pin_model: Pinocchio's model, base included.
        pin_data: Pinocchio's data.
    """

    def __init__(self, urdf: Urdf, pin_model: Any, base: Placement) -> None:
        self.base = base
        self.pin_model = pin_model
        self._make_data()
        self.n: int = pin_model.nv
        by_name = {joint.name: joint for joint in urdf.joints}
        self.joints = tuple(_joint(by_name[name]) for name in list(pin_model.names)[1:])
        self.lower: Array = _frozen([joint.lower for joint in self.joints])
        self.upper: Array = _frozen([joint.upper for joint in self.joints])
        self.velocity: Array = _frozen([joint.velocity for joint in self.joints])
        self.parents: tuple[int, ...] = tuple(int(parent) - 1 for parent in list(pin_model.parents)[1:])
        self._frames = _link_frames(urdf, pin_model)
        self.frame_names: tuple[str, ...] = tuple(self._frames)
        self.bodies = tuple(self._model_body(body) for body in urdf.bodies)
        self.chain: NDArray[np.bool_] = _frozen(
            np.array([self._moved_by(body.joint) for body in self.bodies]).reshape(-1, self.n), bool
        )
        self._body_joints = np.array([body.joint + 1 for body in self.bodies], dtype=np.intp)
        self._body_R = np.array([body.placement.R for body in self.bodies]).reshape(-1, 3, 3)
        self._body_t = np.array([body.placement.t for body in self.bodies]).reshape(-1, 3, 1)

    def _make_data(self) -> None:
        self.pin_data = self.pin_model.createData()
        # References into pinocchio's data: they show the latest result, and fetching them again is slow.
        self._oMi = [self.pin_data.oMi[joint] for joint in range(self.pin_model.njoints)]

    def __getstate__(self) -> dict[str, Any]:
        """Return the state without pinocchio's data: copies of the references would show no results."""
        return {name: value for name, value in vars(self).items() if name not in ("pin_data", "_oMi")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore the state, with new data."""
        self.__dict__.update(state)
        self._make_data()
        for values in (self.lower, self.upper, self.velocity, self.chain):
            values.setflags(write=False)

    @classmethod
    def from_urdf(cls, text: str, base: Placement) -> "RobotModel":
        """Return the model of a URDF text with its base at ``base`` in the world.

        Raises:
            ModelError: The URDF is refused (see ``armgate.cell.urdf``), or has no or too many moving joints.
        """
        urdf = read_urdf(text)
        if all(joint.kind == "fixed" for joint in urdf.joints):
            raise ModelError(
                "the robot has no joint that moves; expected at least one revolute or prismatic joint"
            )
        moving = sum(joint.kind != "fixed" for joint in urdf.joints)
        if moving > MAX_JOINTS:
            raise ModelError(f"the robot has {moving} joints that move; expected at most {MAX_JOINTS}")
        try:
            pin_model = pin.buildModelFromXML(kinematics_only(text))
        except ValueError as error:  # should not happen: our own reading is stricter
            raise ModelError(f"pinocchio refuses the URDF: {error}; see its message on stderr") from error
        _move_root(pin_model, base)
        return cls(urdf, pin_model, base)

    def _model_body(self, body: Any) -> ModelBody:
        frame = self._frames[body.link]
        return ModelBody(body.name, body.link, frame.joint, body.shape, frame.placement @ body.placement)

    def _moved_by(self, joint: int) -> list[bool]:
        moved = [False] * self.n
        while joint >= 0:
            moved[joint] = True
            joint = self.parents[joint]
        return moved

    def body_placements(self, q: ArrayLike) -> tuple[Array, Array]:
        """Return rotations (bodies, 3, 3) and centres (bodies, 3) [m] of all bodies at q, in the world.

        Raises:
            ModelError: q does not have ``n`` numbers.
        """
        pin.forwardKinematics(self.pin_model, self.pin_data, self._checked(q))
        joints = np.array([oMi.homogeneous for oMi in self._oMi])[self._body_joints]
        R = joints[:, :3, :3]
        t = R @ self._body_t
        t += joints[:, :3, 3:]
        return R @ self._body_R, t[:, :, 0]

    def frame(self, q: ArrayLike, name: str) -> Placement:
        """Return the placement of a link's frame at q, in the world.

        Raises:
            ModelError: There is no such frame, or q does not have ``n`` numbers.
        """
        frame = self._frame(name)
        pin.forwardKinematics(self.pin_model, self.pin_data, self._checked(q))
        oMi = self._oMi[frame.joint + 1]
        return Placement(oMi.rotation, oMi.translation) @ frame.placement

    def frame_jacobian(self, q: ArrayLike, name: str) -> Array:
        """Return J (6, n): linear and angular velocity of a frame per joint speed; world axes, at its origin.

        Raises:
            ModelError: There is no such frame, or q does not have ``n`` numbers.
        """
        frame = self._frame(name)
        jacobian = self._joint_jacobian(q, frame.joint)
        if frame.joint >= 0:
            oMi = self._oMi[frame.joint + 1]
            jacobian[:3] += _cross_columns(jacobian[3:], oMi.rotation @ frame.placement.t)
        return jacobian

    def point_jacobian(self, q: ArrayLike, joint_index: int, point_world: ArrayLike) -> Array:
        """Return J (3, n): velocity per joint speed of the point at ``point_world`` [m], moved by a joint.

        Raises:
            ModelError: There is no such joint, or q does not have ``n`` numbers.
        """
        if not -1 <= joint_index < self.n:
            raise ModelError(f"there is no joint {joint_index}; expected -1 (base) to {self.n - 1}")
        jacobian = self._joint_jacobian(q, joint_index)
        arm = np.asarray(point_world, dtype=np.float64) - self._oMi[joint_index + 1].translation
        return jacobian[:3] + _cross_columns(jacobian[3:], arm)

    def frame_placement(self, name: str) -> Placement:
        """Return the placement of a frame in the frame of the joint that moves it, or in the world.

        Raises:
            ModelError: There is no such frame.
        """
        return self._frame(name).placement

    def frame_joint(self, name: str) -> int:
        """Return the index of the joint that moves a frame, -1 for the base.

        Raises:
            ModelError: There is no such frame.
        """
        return self._frame(name).joint

    def _joint_jacobian(self, q: ArrayLike, joint: int) -> Array:
        checked = self._checked(q)
        pin.computeJointJacobians(self.pin_model, self.pin_data, checked)
        if joint < 0:
            return np.zeros((6, self.n))
        jacobian: Array = pin.getJointJacobian(
            self.pin_model, self.pin_data, joint + 1, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        )
        return jacobian

    def _frame(self, name: str) -> _Frame:
        try:
            return self._frames[name]
        except KeyError:
            known = ", ".join(self._frames)
            raise ModelError(f"there is no frame {name!r}; expected one of {known}") from None

    def _checked(self, q: ArrayLike) -> Array:
        array = np.asarray(q, dtype=np.float64)
        if array.shape != (self.n,):
            raise ModelError(f"q has the shape {array.shape}; expected {self.n} numbers")
        return array


def _joint(joint: Any) -> Joint:
    limits = (joint.lower, joint.upper, joint.velocity, joint.acceleration, joint.deceleration)
    return Joint(joint.name, joint.kind, *limits)


def _move_root(pin_model: Any, base: Placement) -> None:
    """Apply the base to all joints and frames that are attached to pinocchio's universe."""
    root = pin.SE3(np.array(base.R), np.array(base.t))
    for joint in range(1, pin_model.njoints):
        if pin_model.parents[joint] == 0:
            pin_model.jointPlacements[joint] = root * pin_model.jointPlacements[joint]
    for number in range(1, pin_model.nframes):
        frame = pin_model.frames[number]
        if frame.parentJoint == 0:
            frame.placement = root * frame.placement


def _link_frames(urdf: Urdf, pin_model: Any) -> dict[str, _Frame]:
    frames = {}
    for link in urdf.links:
        frame = pin_model.frames[pin_model.getFrameId(link, pin.FrameType.BODY)]
        placement = Placement(frame.placement.rotation, frame.placement.translation)
        frames[link] = _Frame(int(frame.parentJoint) - 1, placement)
    return frames


def _cross_columns(columns: Array, arm: Array) -> Array:
    """Return ``columns × arm`` for each column of a (3, n) matrix: velocities at the end of a lever."""
    x, y, z = arm.tolist()
    crossed: Array = np.array(((0.0, z, -y), (-z, 0.0, x), (y, -x, 0.0))) @ columns
    return crossed
