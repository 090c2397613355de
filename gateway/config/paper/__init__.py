"""What a site file says for paper: letterhead, register of equipment, tolerances; its sections and its rules."""
