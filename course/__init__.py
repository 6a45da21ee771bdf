"""What a class is given: editions of the notebooks, a book, slides, and grading."""
