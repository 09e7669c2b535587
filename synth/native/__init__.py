"""What compiled code and Python share: memory.

arrays   declared once, with symbolic shapes: allocated, checked and found by the declaration
views    every array behind one address
"""
