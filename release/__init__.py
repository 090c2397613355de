"""What makes, counts and checks what is handed out: plain Python without a package, run by `make` from this folder.

Never imported by the program, and no part of the wheel.
"""
