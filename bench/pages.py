"""Tables of pages: between two marks, which name the command that makes them."""


def write(path, command, text):
    """Puts `text` in the place of what the command made before."""
    begin, end = f"<!-- made by {command} -->", f"<!-- end of what {command} made -->"
    with open(path, encoding="utf-8") as file:
        before, rest = file.read().split(begin)
    with open(path, "w", encoding="utf-8") as file:
        file.write(f"{before}{begin}\n\n{text}\n\n{end}{rest.split(end)[1]}")
