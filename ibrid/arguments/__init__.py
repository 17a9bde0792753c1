"""What is given to public functions: from what a user has at hand to what they take."""
