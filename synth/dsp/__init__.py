"""From the strings' internal rate to what is heard.

decimator, polyphase   down to the output rate
body                   measured resonances of an instrument's body
limiter                no sample above the ceiling
denormals              subnormal numbers are zero while a block is computed
"""
