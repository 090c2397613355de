"""Does a recorded session tell where the double is more lenient than a control?"""
