"""What is to be expected of a proposal: the flank with its uncertainty, which error matters, which to measure next.

Called by the workflow, before anything is pushed. The rule: a prediction is worth its u only if machines drawn from the
doubts keep to it; tests draw them.
"""
