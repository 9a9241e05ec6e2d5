"""Inflate the simulated rig's sheet, put measured and simulated heights into a table, and draw the shape."""

from labctl import api

with api.doubles(speed=10) as rig:
    measured = api.inflate("sphere", rig=rig)

shape = api.simulate("sphere", pressure="3.9 psi")
heights = measured.heights  # a pandas table, a row a marker
heights["off_mm"] = heights["height_mm"] - heights["simulated_mm"]
print(heights.round(2).to_string(index=False))
print(f"e_t {measured.e_t_percent:.1f} %, mean height error {measured.mean_height_error_mm:.2f} mm")
shape.plot("sphere.png")

at_markers = shape.heights(list(zip(heights["x_mm"], heights["y_mm"], strict=True)))
assert (at_markers["height_mm"] - heights["simulated_mm"]).abs().max() < 1e-6
assert measured.e_t_percent is not None and measured.e_t_percent < 2
