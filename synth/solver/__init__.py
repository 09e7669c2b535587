"""One string and its contacts through time: compiled schemes, and the contact problem of a step.

schemes                        every scheme by name
stringmodel                    a string as compiled code has it: model, state, scratch, declared once
step                           `advance`: steps by the kernel that does them fastest, for the engine and `simulate`
laws, contact_laws, problem    a mode's step coefficients under each scheme; what a scheme is given and gives
lcp                            the contact problem of several points
stepwise, layers, substeps     a step after the other, by any law; soft layers in front of what is rigid; divided steps
certificates                   which contacts free flight cannot reach
lanes, responses, sequence, blocks, fingers   eight steps of every mode at a time, as the engine runs them
two_step, penalty              compliant contacts, with `compliant`, `quadratisation` or `sav` for the force of a step
wall, sine, clearance, propagators   contact along a stretch, at the nodes of the modal grid
driver, study, energy          a run with rows and an energy ledger
"""
