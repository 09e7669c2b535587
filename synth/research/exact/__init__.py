"""Exact solutions of contact problems, to judge schemes by: each in a closed form or with no step of its own.

waveguide      ideal string over any point obstacles: travelling waves, and the first-order reflection they are equal to
triangle       ideal string plucked to a triangle: over a point at mid-string (Cabannes), over a flat wall
bar            elastic bar thrown against a wall (Doyen, Ern and Piperno)
event_driven   stiff, lossy string of N modes over one point, restitution 0: every landing and release found exactly
"""
