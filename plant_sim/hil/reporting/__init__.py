"""Report of a run of the bench as text, HTML, JUnit and timing diagrams."""
