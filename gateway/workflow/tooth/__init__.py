"""The correction for the tooth: from an error model to axis and cross tables, and what they do to the flank."""
