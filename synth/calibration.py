"""Which internal rate keeps which promise, as measured on random strings. Written by tools/calibrate-plan."""

#: scene, quality → internal steps per period of a string of 200 Hz, exponent p: rate = steps · 200 Hz · (f₀/200 Hz)^p
STEPS = {
    "bridge": {
        "draft": (220.0, 0.7),
        "standard": (800.0, 0.7),
        "fine": (2300.0, 0.7),
        "reference": (5400.0, 1.0),
    },
    "impacts": {
        "draft": (220.0, 1.0),
        "standard": (2000.0, 1.0),
        "fine": (5700.0, 1.0),
        "reference": (10800.0, 1.0),
    },
}
