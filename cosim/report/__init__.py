"""The report of a diagnosis: one offline HTML file, made from a diagnosis folder."""
