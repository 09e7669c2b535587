"""Which internal rate keeps which promise, as measured on random strings. Written by tools/calibrate-plan."""

#: scene, quality → internal steps per period of the string
STEPS = {
    "bridge": {
        "draft": 250.0,
        "standard": 360.0,
        "fine": 1100.0,
        "reference": 5400.0,
    },
    "far": {
        "draft": 1100.0,
        "standard": 2900.0,
        "fine": 8100.0,
        "reference": 18000.0,
    },
    "impacts": {
        "draft": 250.0,
        "standard": 2500.0,
        "fine": 3600.0,
        "reference": 10800.0,
    },
}
