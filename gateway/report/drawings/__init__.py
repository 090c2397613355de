"""Everything a report draws, onto given matplotlib figures, as inline SVG or PNG; loaded only when it draws."""
