"""The report of a store as one HTML page, of which everything is inside the file.

- report_page: the page from its template (page.html, page.css, page.js)
- case_section: the sections of one case, and what the store lacks
- machine_section, linear_section, branch_section: their figures and tables
- warnings: what failed, ended early or is in doubt
- stability_plane: a map on which a click shows the nearest stored cycle
- stored_cycles: the cycles in the page
- elements: tables, lists and figures as HTML
"""
