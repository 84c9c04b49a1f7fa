"""The local page of `cosim open`: a log is dropped, its columns are mapped, the diagnosis is watched and explored.

`server.py` is the HTTP end and knows nothing of logs; `session.py` is what has been dropped and what runs, a client of
`cosim.api`; `form.py` and `mapping.py` go from a file's columns to a form and from the form to a mapping.
"""
