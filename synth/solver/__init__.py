"""One string and its contacts through time: compiled schemes, and the contact problem of a step.

laws, problem                  a mode's step coefficients under each scheme; what a scheme is given and gives
lcp                            the contact problem of several points
kernels, substeps              a step after the other, readable
lanes, blocks, fingers         eight steps of every mode at a time, as the engine runs them
two_step, penalty              compliant contacts, with `compliant`, `quadratisation` or `sav` for the force of a step
wall, sine, clearance, flights contact along a stretch, at the nodes of the modal grid
driver, energy                 a run with rows and an energy ledger
"""
