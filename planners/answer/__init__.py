"""What planners answer: outcomes of posture problems, plans of courses, and their files."""
