"""What compiled code and Python share with the machine: memory, registers, processors, clocks, threads.

arrays                    declared once, with symbolic shapes: allocated, checked and found by the declaration
views                     every array behind one address
simd, atomics, denormals  vectors, words that threads share, numbers too small to count
processors, clocks        how many there are; the time, and memory by its address
patience, stderr          waiting for what may never answer; standard error without what C libraries print
"""
