"""What a doctor asks of a control after the login: the server, the machine, the settings that our programs need.

Called by the doctor alone; every question is a read, and gives lines.
"""
