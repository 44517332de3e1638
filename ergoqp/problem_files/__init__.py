"""Problems as TOML files."""
