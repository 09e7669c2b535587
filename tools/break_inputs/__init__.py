"""Broken inputs: what they are made from (`seeds`), how they are broken (`damage`), what is asked of the program (`trial`),
and a process that tries them one after the other (`worker`) under a watch (`watch`)."""
