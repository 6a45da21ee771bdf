"""What a class is given: editions of the notebooks, the book, the slides, and the
grading.
"""
