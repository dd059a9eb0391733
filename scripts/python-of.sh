# Finds interpreters: `. scripts/python-of.sh`, then `python_of 3.12` prints the path of one.

# A shim of pyenv is there for each interpreter, and runs those that are chosen alone.
python_of() {
  local found
  for found in "$(command -v "python$1")" $(compgen -G "${PYENV_ROOT:-$HOME/.pyenv}/versions/$1.*/bin/python3" | sort -rV); do
    if [ -n "$found" ] && "$found" -c "" 2>/dev/null; then
      echo "$found"
      return
    fi
  done
  return 1
}
