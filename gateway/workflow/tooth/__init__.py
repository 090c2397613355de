"""The tooth: from an error model to axis and cross tables and their effect on the flank; parts ground and inspected."""
