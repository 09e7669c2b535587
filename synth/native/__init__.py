"""What compiled code and Python share: memory; and what the machine has.

arrays       declared once, with symbolic shapes: allocated, checked and found by the declaration
views        every array behind one address
processors   how many there are
"""
