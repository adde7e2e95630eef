"""Configuration of poses, shapes and meshes."""

from typing import Annotated, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from armgate.cell.config.fields import Angle, ConfigModel, Factor, Length, Name, Size, SparseModel
from armgate.cell.placement import Placement
from armgate.cell.shapes import Kind, Shape, shape_from


class Pose(ConfigModel):
    """Position and orientation of a frame in another one."""

    xyz: tuple[Length, Length, Length] = (0.0, 0.0, 0.0)
    """Position of the origin [m]."""
    rpy: tuple[Angle, Angle, Angle] = (0.0, 0.0, 0.0)
    """Orientation as roll, pitch and yaw, as in URDF [rad]."""

    @property
    def placement(self) -> Placement:
        """The pose as a placement."""
        return Placement.from_rpy(self.xyz, self.rpy)


def _for_all_axes(given: object) -> object:
    """Repeat a single factor for all three axes."""
    return (given,) * 3 if isinstance(given, float | int) and not isinstance(given, bool) else given


class MeshOptions(ConfigModel):
    """Options of the convex decomposition: how a mesh becomes convex bodies that together contain it."""

    method: Literal["parts", "hull"] = "parts"
    """``parts`` cuts the mesh into convex parts that follow its form; ``hull`` uses its convex hull."""
    threshold: Annotated[float, Field(ge=0.01, le=10.0)] = 0.1
    """Excess volume at which cutting ends: volume of all parts beyond that of the mesh, as a share of it."""
    max_parts: Annotated[int, Field(ge=1, le=256)] = 16
    """Largest number of parts of one mesh."""
    max_vertices: Annotated[int, Field(ge=32, le=255)] = 96
    """Largest number of corners of a part; the part is thickened so that it contains the omitted corners."""


class MeshConfig(MeshOptions):
    """Mesh as a shape."""

    file: str
    """File of the mesh: a path relative to the file that contains the key, ``file://…`` or ``package://…``."""
    scale: Annotated[tuple[Factor, Factor, Factor], BeforeValidator(_for_all_axes)] = (1.0, 1.0, 1.0)
    """Factor that converts the coordinates of the file to m: one number, or one for each axis."""


class MeshesConfig(MeshOptions):
    """Options for the meshes in the URDF of a robot."""

    packages: dict[Name, str] = {}
    """Folders of packages for ``package://NAME/…``, relative to the file that contains the key."""
    bodies: dict[Name, MeshOptions] = {}
    """Other options for single links or bodies of the URDF, by name."""


class ShapeConfig(SparseModel):
    """Shape, centred in its frame, with its axis along z; exactly one key is given."""

    sphere: Size | None = None
    """Radius of a sphere [m]."""
    capsule: tuple[Size, Size] | None = None
    """Radius, and length without the caps, of a capsule [m]."""
    cylinder: tuple[Size, Size] | None = None
    """Radius and length of a cylinder [m]."""
    box: tuple[Size, Size, Size] | None = None
    """Edges of a box along x, y and z [m]."""
    cone: tuple[Size, Size] | None = None
    """Radius of the base, at −length/2, and length of a cone [m]."""
    mesh: MeshConfig | None = None
    """Mesh, which becomes one or more convex bodies."""

    @model_validator(mode="after")
    def _one(self) -> Self:
        count = len(self._primitives()) + (self.mesh is not None)
        if count != 1:
            known = ", ".join(type(self).model_fields)
            raise ValueError(f"{count} shapes; expected exactly one of {known}")
        return self

    def _primitives(self) -> dict[Kind, tuple[float, ...]]:
        sphere = None if self.sphere is None else (self.sphere,)
        sizes: dict[Kind, tuple[float, ...] | None] = {
            "sphere": sphere,
            "capsule": self.capsule,
            "cylinder": self.cylinder,
            "box": self.box,
            "cone": self.cone,
        }
        return {kind: size for kind, size in sizes.items() if size is not None}

    @property
    def shape(self) -> Shape:
        """The primitive.

        Raises:
            ValueError: The shape is a mesh.
        """
        ((kind, size),) = self._primitives().items()
        return shape_from(kind, size)
