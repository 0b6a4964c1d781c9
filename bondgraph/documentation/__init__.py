"""The documentation: pages in Markdown, tutorials as scripts, a notebook, and the site that is built of them.

scripts     tutorials, each of which runs alone; pages include them literally, with what they print and draw
pages       what a person reads, in the order of a machine's way from declaration to correction
notebooks   the whole flow, stored without outputs
reference   pages made from the toolkit: dictionary of effects, commands, names with their docstrings, schema
site        all of it staged in a folder, scripts run, and built to HTML that needs no network
"""

from bondgraph.documentation.site import build_site as build_site
