"""Files as they are read and written, whatever is in them.

sources   what is read: refused in one line where it is no such file, too large or never ends
targets   what is written: beside, then renamed; whole or not there
folders   the same for a folder
unfinished  what lies beside until then, and what killed processes leave of it
npz       NumPy archives
"""
