"""The control's language: text to words to syntax. Pure, and knows no machine."""
