"""Two packages at the same music, round by round in turn: how many times faster is one than the other?"""
