"""What can be corrected, by what, and how much is left on the tooth (mm, rad)."""
