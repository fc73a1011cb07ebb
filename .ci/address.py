"""The project's address on the web, in one place; empty as long as it is published nowhere.

README, CITATION.cff and pyproject.toml name it where there is one (a clone line, repository-code,
urls), and name none while it is empty; tests/test_address.py compares them.
"""

ADDRESS = ""
