"""One module per subcommand: a case in, groups of a store out; and the scheduling of many cases."""
