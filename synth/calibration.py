"""Which internal rate keeps which promise, as measured on random strings. Written by tools/calibrate-plan."""

#: scene, quality → internal steps per period of a string of 200 Hz, exponent p: rate = steps · 200 Hz · (f₀/200 Hz)^p
STEPS = {
    "bridge": {
        "draft": (250.0, 1.0),
        "standard": (360.0, 1.0),
        "fine": (1100.0, 1.0),
        "reference": (5400.0, 1.0),
    },
    "impacts": {
        "draft": (250.0, 0.6),
        "standard": (2500.0, 0.6),
        "fine": (4000.0, 0.6),
        "reference": (10800.0, 1.0),
    },
}
