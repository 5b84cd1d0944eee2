"""Virtual trials whose missing effect is sealed, and the judgement of what is found in them.

An implementation of the paper, of sensors and of missing effects that shares no code with the
model, the effects or the fits, and uses other formulas where the literature has rivals.
"""
