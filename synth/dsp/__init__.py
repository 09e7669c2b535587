"""From the strings' internal rate to what is heard, and what can be measured in it.

decimator, polyphase   down to the output rate; rates: which there can be
effect                 what an effect is; body_effect, limiter_effect, delay_effect: those there are
body                   measured resonances of an instrument's body
limiter                no sample above the ceiling
measures               pitch, decay, spectra of a sound
"""
