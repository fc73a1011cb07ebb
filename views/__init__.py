"""Pictures, pages and films of scenes, answers and runs."""
