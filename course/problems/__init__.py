"""Model solutions of the weekly problems, and what a program can judge of an answer.

Students find neither here nor on the site what is in this folder: the problems
themselves are in `docs/course/problems`.
"""
