"""The sheet as a lattice of voxels: geometry, materials, link law, two solvers."""
