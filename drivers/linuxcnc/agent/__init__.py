"""The agent beside a LinuxCNC kernel: started there with `python3 -m drivers.linuxcnc.agent`, asked by JSON lines.

Standard library only, and the modules `linuxcnc` and `hal` that the kernel's package brings. Nothing here starts a
program, moves a joint or takes an emergency stop back: a person at the machine does.
"""
