"""People: sessions, recordings, reports, and the mock arena that needs no hardware."""
