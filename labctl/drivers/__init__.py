"""One plain class for each real device, reading like the device's manual."""
