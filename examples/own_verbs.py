"""Half the pressure with half the fibers, by the rig's own verbs: what no protocol does yet."""

import numpy as np

from labctl import api

with api.doubles(speed=10) as config, api.open_rig(config) as rig:
    print(f"the gauge reads {rig.pressure().gauge_psi:+.2f} psi")
    rig.jam({1, 2, 3})
    rig.start_control()
    rig.ramp_to(2.0, lambda reading: None)
    held = rig.settle(2.0, lambda reading: None)
    frames, _ = rig.capture(1.0)
    report = rig.make_safe()

print(f"held {np.mean(held.pressures_psi):.2f} psi; {len(frames)} frames; {report.describe()}")
assert abs(np.mean(held.pressures_psi) - 2.0) < 0.1
assert report.safe
