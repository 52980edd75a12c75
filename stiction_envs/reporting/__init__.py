"""The only writers of files for people: Markdown, HTML, PNG, TOML, all of them atomic."""
