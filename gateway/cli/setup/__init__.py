"""The site file: made, checked, and compared with the control; nothing here moves or writes a machine."""
