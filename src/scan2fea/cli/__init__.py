"""The only room that talks: arguments in, one line per error out, exit codes. Heavy rooms are imported by the command that needs them."""
