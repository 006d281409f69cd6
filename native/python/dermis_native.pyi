"""Dermis: skin weights and volume-keeping skin for articulated characters.

Arrays are numpy arrays in C order. Float input may be float32 or float64, index input any integer type.
Lengths are in the caller's unit. Wrong shapes, indices out of range and NaN or infinite input raise `ValueError`
naming the element; every other failure a subclass of `DermisError`. Long calls release the interpreter lock.
"""

from collections.abc import Sequence
from typing import Any, Literal, Self, final

import numpy as np
import numpy.typing as npt

_Floats = npt.NDArray[np.floating[Any]]
_Integers = npt.NDArray[np.integer[Any]]

_RetargetPart = Literal["auto", "rigid", "surface", "match"]
_BindPart = Literal["auto", "rigid", "surface", "own"]
_Mask = npt.NDArray[np.bool_] | Sequence[bool]
_Choice = _Mask | _Integers | Sequence[int]

__all__ = [
    "BiharmonicDistance",
    "BoneMap",
    "Cancelled",
    "DermisError",
    "FittedSkeleton",
    "NumericalError",
    "PbdSkin",
    "Progress",
    "RetargetError",
    "RetargetResult",
    "Skeleton",
    "SkinWeights",
    "TetMesh",
    "TriangleMesh",
    "__version__",
    "bind_weights",
    "dual_quaternion_skinning",
    "eigenpairs",
    "fit_skeleton",
    "laplacian",
    "linear_blend_skinning",
    "map_bones",
    "pbd_preset",
    "rest_space_offsets",
    "retarget_weights",
    "tetrahedralize",
]

__version__: str

class DermisError(Exception):
    """Base of every failure that is not a wrong argument."""

class NumericalError(DermisError):
    """A factorisation broke down or an eigen solve did not reach its residual bound."""

class RetargetError(DermisError):
    """The characters cannot be matched: no landmarks, no common bones, nothing to match."""

class Cancelled(DermisError):
    """`Progress.cancel` was called; nothing was changed."""

@final
class Progress:
    """Shared between the thread that works and the thread that watches."""

    def __new__(cls) -> Self: ...
    def cancel(self) -> None:
        """Ask the running call to stop; it raises `Cancelled` soon afterwards."""
    @property
    def cancelled(self) -> bool: ...
    @property
    def fraction(self) -> float:
        """Share of the work done, 0 to 1."""
    @property
    def stage(self) -> str:
        """What is being done now, for a status bar."""

@final
class TriangleMesh:
    """Triangles over shared vertices: any topology, several components, boundaries allowed."""

    def __new__(cls, vertices: _Floats, triangles: _Integers) -> Self:
        """vertices (V,3) and triangles (F,3); raises ValueError naming the first bad element."""
    @staticmethod
    def from_polygons(vertices: _Floats, loop_counts: _Integers, loop_indices: _Integers) -> TriangleMesh:
        """Polygons as flat vertex indices; each polygon is cut into triangles at its best diagonals."""
    @property
    def vertices(self) -> npt.NDArray[np.float64]: ...
    @property
    def triangles(self) -> npt.NDArray[np.uint32]: ...
    @property
    def components(self) -> npt.NDArray[np.uint32]:
        """Component of each vertex (V,), numbered by their smallest vertex; loose vertices count."""
    @property
    def boundary_edges(self) -> npt.NDArray[np.uint32]:
        """(E,2) vertex pairs used by exactly one triangle."""
    @property
    def non_manifold_edges(self) -> npt.NDArray[np.uint32]:
        """(E,2) vertex pairs used by more than two triangles."""
    @property
    def degenerate_triangles(self) -> npt.NDArray[np.uint32]:
        """Triangles with a repeated vertex or no area."""

@final
class Skeleton:
    """Bones as head and tail points in the mesh's space; parents index bones, -1 is a root."""

    def __new__(
        cls, heads: _Floats, tails: _Floats, parents: _Integers, names: Sequence[str] | None = None
    ) -> Self: ...
    @property
    def heads(self) -> npt.NDArray[np.float64]: ...
    @property
    def tails(self) -> npt.NDArray[np.float64]: ...
    @property
    def parents(self) -> npt.NDArray[np.int32]: ...
    @property
    def names(self) -> list[str] | None: ...
    def __len__(self) -> int: ...

@final
class BoneMap:
    """For each bone of a source skeleton the bones of a target skeleton that stand for it.

    No target bone: the weight goes to the nearest mapped ancestor, or, without one, descendant. One: it takes the
    weight; several source bones may name it. Several: a chain, top first, that splits it by position.
    """

    def __new__(cls, source_skeleton: Skeleton, target_skeleton: Skeleton, targets: Sequence[Sequence[int]]) -> Self:
        """Your own map: for each source bone its target bones. Raises ValueError naming the first bad bone."""
    @property
    def targets(self) -> list[list[int]]: ...
    @property
    def how(self) -> list[str]:
        """How each source bone's targets were found: "name", "scheme", "structure", "user" or "none"."""
    @property
    def carriers(self) -> list[int]:
        """Source bone whose targets take each source bone's weight: itself, or the one that gathers it."""
    def aligned_skeleton(self, source_skeleton: Skeleton, target_skeleton: Skeleton) -> Skeleton:
        """The source skeleton, numbered and named as it is, at the target's rest positions."""
    def transfer(self, weights: SkinWeights, vertices: _Floats, target_skeleton: Skeleton) -> SkinWeights:
        """Weights of the target's vertices (V,3), from source bones to target bones; sums of rows stay."""
    def __len__(self) -> int: ...

def map_bones(source_skeleton: Skeleton, target_skeleton: Skeleton) -> BoneMap:
    """Map bones by equal names, by the common naming schemes, then by structure and position.

    Known are Rigify, Mixamo, Unreal, MakeHuman, VRM, 3ds Max Biped and Daz names. Chains of different length are
    matched by arc length; left never goes to right. Raises RetargetError when no bone has a counterpart.
    """

@final
class SkinWeights:
    """Sparse weights, one row per vertex, one column per bone."""

    @staticmethod
    def from_dense(weights: _Floats) -> SkinWeights:
        """weights (V,B), finite and not negative."""
    @staticmethod
    def from_triplets(
        vertex: _Integers, bone: _Integers, value: _Floats, vertex_count: int, bone_count: int
    ) -> SkinWeights:
        """Entries (n,); values of a repeated pair are added."""
    def to_dense(self) -> npt.NDArray[np.float32]: ...
    def to_triplets(self) -> tuple[npt.NDArray[np.uint32], npt.NDArray[np.uint32], npt.NDArray[np.float32]]:
        """vertex, bone and value of every entry above zero, ordered by vertex, then bone."""
    def normalized(self) -> SkinWeights:
        """Rows scaled to a sum of 1; a row without weights stays empty."""
    @property
    def vertex_count(self) -> int: ...
    @property
    def bone_count(self) -> int: ...

@final
class BiharmonicDistance:
    """Biharmonic distance on a surface (eq. 17-19), infinite between components.

    `between` uses a truncated eigenbasis, O(eigenpairs) for each pair; `from_vertex` is exact: two sparse solves.
    """

    def __new__(cls, mesh: TriangleMesh, *, eigenpairs: int = 100, progress: Progress | None = None) -> Self: ...
    def between(self, i: _Integers, j: _Integers) -> npt.NDArray[np.float64]:
        """Distances (n,) of the vertex pairs i[n], j[n]."""
    def from_vertex(self, i: int) -> npt.NDArray[np.float64]:
        """Distances (V,) of every vertex to vertex i."""
    @property
    def eigenvalues(self) -> npt.NDArray[np.float64]:
        """Ascending, without the zero of each component."""

def laplacian(
    mesh: TriangleMesh,
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64], npt.NDArray[np.int64], npt.NDArray[np.float64]]:
    """Robust Laplace-Beltrami operator (tufted intrinsic Delaunay, Sharp & Crane 2020).

    Returns the positive semi-definite stiffness matrix in CSC form as (data, indices, indptr) and
    the lumped vertex areas (V,).
    """

def eigenpairs(
    mesh: TriangleMesh, count: int, *, progress: Progress | None = None
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """The `count` smallest non-zero eigenpairs of the Laplacian: values (k,), mass-orthonormal vectors (V,k)."""

@final
class RetargetResult:
    """What `retarget_weights` found."""

    @property
    def weights(self) -> SkinWeights:
        """Weights of the target, columns in the order of the target's bones."""
    @property
    def correspondence(self) -> npt.NDArray[np.int64]:
        """Source vertex matched to each target vertex (Vt,)."""
    @property
    def matched(self) -> npt.NDArray[np.bool_]:
        """True where a vertex was matched by the surface, False where it was filled in (Vt,)."""
    @property
    def status(self) -> npt.NDArray[np.uint8]:
        """Where each vertex has its weights from (Vt,): 0 its match on the source (`matched`), 1 inpainted from its
        neighbours, 2 the treatment of its loose part (rigid, or after the surface below), 3 the closest point of the
        source, although no match near it passed the tests.
        """
    @property
    def part(self) -> npt.NDArray[np.uint32]:
        """Loose part of each vertex (Vt,), connected once seams that only an export had opened are closed, numbered
        by smallest vertex. Empty by method "paper", which knows no parts.
        """
    @property
    def part_policies(self) -> list[str]:
        """What became of each part: "rigid", "surface" or "match"."""
    @property
    def body(self) -> int | None:
        """The part that is the body, the one of the largest area; None by method "paper"."""
    @property
    def landmarks(self) -> npt.NDArray[np.int64]:
        """Landmark pairs used (k,2): source vertex, target vertex."""

def retarget_weights(
    source: TriangleMesh,
    source_weights: SkinWeights,
    target: TriangleMesh,
    *,
    source_skeleton: Skeleton | None = None,
    target_skeleton: Skeleton | None = None,
    bone_map: BoneMap | None = None,
    landmarks: _Integers | None = None,
    method: Literal["auto", "paper"] = "auto",
    parts: _RetargetPart | Sequence[_RetargetPart] | None = None,
    max_influences: int | None = None,
    eigenpairs: int = 100,
    progress: Progress | None = None,
) -> RetargetResult:
    """Give `target` the weights of `source`.

    "auto" warps the source onto the target's skeleton and rest pose, refines the joints against the surfaces, deforms
    the surface onto the target's, matches by closest points, and inpaints where no match passes its tests. It needs
    both skeletons; without them "paper" is used.

    "paper" is Algorithm 2: distances to landmarks. Without landmarks both skeletons are needed and landmarks are
    chosen on them: head, hands and knees of a biped, otherwise the end of every chain. With both skeletons matches
    are searched in the same region only (figure 3).

    landmarks (k,2) pairs a source vertex with a target vertex; "auto" adds its own to them, "paper" uses them instead
    of its own. With both skeletons, bones are paired by `map_bones` unless `bone_map` is given. parts says what
    becomes of loose parts of the target: "rigid" gives a part one row of weights, "surface" every vertex those of the
    nearest point of the body, "match" matches it with the source like the body (one without any match follows the
    surface after all), "auto" and None choose. One name is for all parts but the body; a sequence has one for each
    component as `TriangleMesh.components` numbers them, and there the body is what it is said to be. Components that
    coincident open edges make one part must not contradict each other. "auto" method alone.
    """

def bind_weights(
    mesh: TriangleMesh,
    skeleton: Skeleton,
    *,
    method: Literal["volumetric", "paper"] = "volumetric",
    parts: _BindPart | Sequence[_BindPart] | None = None,
    max_influences: int | None = None,
    bones: _Choice | None = None,
    protected: _Choice | None = None,
    weights: SkinWeights | None = None,
    progress: Progress | None = None,
) -> SkinWeights:
    """Weights for a mesh that has none, from its skeleton alone.

    "volumetric": through the body, after the idea of geodesic voxel binding (Dionne & de Lasa 2013). A vertex belongs
    to the bone that is near through the body and that a random walk from it meets first; a diffusion over the surface
    makes the falloff. Works on any mesh with a triangle: open, in pieces, self-intersecting, flat, with bones
    outside; what no bone reaches follows the nearest surface. "paper": by the distance through the air to the three
    nearest bones in a joint area, to the two nearest elsewhere (eq. 2, section 4.1); a vertex on a bone belongs to it.

    bones chooses those that take part, as a mask (B,) or as indices; None takes all. max_influences limits the bones
    of a vertex; weights fade out before they are cut off. Rows sum to 1. parts says what becomes of loose parts, for
    all but the body or for each component as in `retarget_weights`: "rigid" (one row of weights), "surface" (each
    vertex follows the nearest point of the body), "own" (bound to the bones by itself), or "auto": small parts and
    those that no bone reaches go with the body, others are bound by themselves. "volumetric" alone.

    protected vertices, as a mask (V,) or as indices, keep their rows of `weights` (V,B) bit for bit.
    """

@final
class FittedSkeleton:
    """What `fit_skeleton` found."""

    @property
    def skeleton(self) -> Skeleton:
        """The template's bones, parents and names at their fitted rest positions in the mesh's space."""
    @property
    def method(self) -> Literal["embedding", "template"]:
        """Embedded into the shape, or only scaled and moved as a whole with its joints pulled inside."""
    @property
    def score(self) -> float:
        """How well the skeleton fits, 0 to 1: bones inside, lengths plausible, the trunk like the template's up to
        a turn, and no limb of the mesh without bones. Below 0.5 the template is doubtful.
        """
    @property
    def message(self) -> str:
        """What was not found, what has no bones, or why the template was only scaled; empty when all is well."""
    @property
    def found(self) -> npt.NDArray[np.bool_]:
        """(B,) True where the shape placed the bone, False where it was carried along."""
    @property
    def symmetric(self) -> bool:
        """Whether a mirror plane of mesh and template was used."""

def fit_skeleton(
    mesh: TriangleMesh,
    template: Skeleton,
    *,
    deform: _Mask | None = None,
    fixed: _Mask | None = None,
    symmetric: bool | None = None,
    progress: Progress | None = None,
) -> FittedSkeleton:
    """Fit a template skeleton into a mesh, after Baran & Popović (2007).

    Both stand upright and face the same way; place, size, proportions and the angles of the limbs may differ. deform
    (B,) marks the bones that follow the body, None all; the others, such as controls, are carried along. Bones that
    fixed (B,) marks keep their heads and tails exactly. symmetric says whether to use the mirror plane; None uses it
    where mesh and template have one. Connected bones stay connected. Where the shape and the template do not agree, or
    the mesh encloses no volume, the template is scaled and moved as a whole; `method`, `score` and `message` say so.
    """

def linear_blend_skinning(vertices: _Floats, weights: SkinWeights, transforms: _Floats) -> npt.NDArray[np.float32]:
    """Linear blend skinning (eq. 1) as Blender's Armature modifier computes it.

    vertices (V,3), transforms (B,4,4) = pose · rest⁻¹; returns (V,3) float32. Weights need not sum to 1; a vertex
    without weights stays where it is.
    """

def dual_quaternion_skinning(
    vertices: _Floats, weights: SkinWeights, transforms: _Floats, *, rest: _Floats | None = None
) -> npt.NDArray[np.float32]:
    """Dual quaternion skinning as Blender's Preserve Volume computes it, called like `linear_blend_skinning`.

    rest (B,4,4) are the bones' rest matrices, which matter only where bones are scaled.
    """

def rest_space_offsets(
    offsets: _Floats,
    weights: SkinWeights,
    transforms: _Floats,
    *,
    preserve_volume: bool = False,
    shares: _Floats | None = None,
) -> tuple[npt.NDArray[np.float32], int]:
    """Offsets (V,3) of the skinned surface taken back to rest by the inverse of what skinning does at each vertex:
    what a shape key has to hold under a live Armature modifier.

    shares (V,), 0 to 1, say how much of the skinning each vertex follows. Returns the offsets (V,3) float32 and the
    number of vertices whose blended matrix is nearly singular; their offsets are limited.
    """

@final
class TetMesh:
    """Tetrahedra (T,4) over shared vertices (P,3), positively oriented; of a skin, all islands in rest."""

    @property
    def vertices(self) -> npt.NDArray[np.float64]: ...
    @property
    def tetrahedra(self) -> npt.NDArray[np.uint32]: ...

def tetrahedralize(mesh: TriangleMesh, *, cell_size: float | None = None) -> TetMesh:
    """Body-centred-cubic lattice tetrahedra around and inside any triangle mesh: open, in pieces,
    self-intersecting, non-manifold. Without `cell_size` the mean thickness of the mesh decides.
    """

@final
class PbdSkin:
    """A character's skin with joints that keep their volume (section 4.2).

    Built once; `solve` is then a pure function from poses to vertices: the same arguments give the same bits, whatever
    was solved before and on any number of threads. Every setting that is None comes from `preset`: "default", "paper"
    (Algorithm 1 as printed) or "rumman_fratarcangeli". Constraint strengths (`stretch`, `volume`, `bind`, `energy`) go
    from 0 (off) to 1. `stiffness_shares` (V,), 0 to 1, lets the stiffness vary over the surface. `rest` (B,4,4) are
    the bones' rest matrices for `skinning="dual_quaternion"`, as in `dual_quaternion_skinning`.
    """

    def __new__(
        cls,
        mesh: TriangleMesh,
        skeleton: Skeleton,
        weights: SkinWeights,
        *,
        preset: Literal["default", "paper", "rumman_fratarcangeli"] = "default",
        iterations: int | None = None,
        volume_sweeps: int | None = None,
        start: Literal["auto", "linear", "dual_quaternion"] | None = None,
        skinning: Literal["linear", "dual_quaternion"] = "linear",
        stretch: float | None = None,
        volume: float | None = None,
        bind: float | None = None,
        energy: float | None = None,
        energy_form: Literal["compliant", "paper"] | None = None,
        stiffness: float | None = None,
        self_collision: bool | None = None,
        smoothing: float | None = None,
        region: Literal["joints", "all"] | None = None,
        cell_size: float | None = None,
        threads: int | None = None,
        stiffness_shares: _Floats | None = None,
        rest: _Floats | None = None,
    ) -> Self: ...
    def solve(self, transforms: _Floats, vertices: _Floats | None = None) -> npt.NDArray[np.float32]:
        """Vertices (V,3) float32 of a pose: transforms (B,4,4) = pose · rest⁻¹. vertices (V,3) replace
        the rest positions, for shape keys that act before the armature.
        """
    def solve_offsets(
        self, transforms: _Floats, vertices: _Floats | None = None, shares: _Floats | None = None
    ) -> tuple[npt.NDArray[np.float32], int]:
        """A pose like `solve`, as offsets (V,3) float32 that plain skinning turns into the solved skin: what a shape
            key has to hold under a live Armature modifier.

        shares (V,), 0 to 1, say how much of the skinning, and of the correction, each vertex follows. Also returns the
        number of vertices whose blended matrix is nearly singular; their offsets are limited.
        """
    @property
    def cage(self) -> TetMesh: ...
    @property
    def stats(self) -> dict[str, Any]:
        """What the skin consists of and what the last solve took: vertices, moved_vertices, tetrahedra, islands,
        active_islands, inverted, constraints (per kind), milliseconds (build, skinning, solve, surface, total), and
        counted work (solved_islands, reused_islands, projections, contact_candidates, corrected_vertices).
        """

def pbd_preset(preset: Literal["default", "paper", "rumman_fratarcangeli"]) -> dict[str, Any]:
    """Settings of a preset of `PbdSkin` by name; what it leaves open (cell_size, threads) is None."""
