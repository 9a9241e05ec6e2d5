"""The sheet as a lattice of voxels: geometry, materials, link law, two solvers."""

# For programs of others; the modules that are not named are the package's own.
__all__ = [
    "errors",
    "fiber_voxels",
    "geometry",
    "heights",
    "materials",
    "registration",
    "score",
    "shape",
    "sheet",
    "solve",
    "solver",
    "targets",
]
