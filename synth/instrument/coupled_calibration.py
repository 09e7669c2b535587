"""What strings that share a body keep of what is promised, on random ones. Written by tools/calibrate-coupled."""

#: scene, quality → whose limits are kept, and how many times these
HELD = {
    "bridge": {"draft": ("draft", 1.0), "standard": ("standard", 1.0), "fine": ("fine", 1.0)},
    "impacts": {"draft": ("draft", 1.0), "standard": ("standard", 2.0), "fine": ("standard", 2.0)},
}
#: largest e over 3 s of strings that touch nothing, at any quality
FREE_ERROR = 0.001
#: open strings that were measured, lowest and highest [Hz]
PITCHES_HZ = (82.4, 311.1)
