"""Files of answers: problems and answers, plans, proofs and walks, read, judged and written."""
