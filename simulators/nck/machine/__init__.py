"""The machine behind the control: axes, machine data, compensation, memory, motion. It knows no program."""
