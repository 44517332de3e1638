"""From joint centres to postures."""
