#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Meshes the geometries beside it with Gmsh, those that are missing or older: FOLDER/NAME.msh.
# usage: simulator/scenes/make_meshes.sh FOLDER
set -eu
[ $# -eq 1 ] || {
  echo "usage: $0 FOLDER" >&2
  exit 2
}
here=$(dirname "$0")
folder=$1
command -v gmsh >/dev/null || {
  echo "$0: gmsh is missing; 'setup/install.sh mesh' installs it" >&2
  exit 1
}
mkdir -p "$folder"

# mesh NAME GEOMETRY SIZE_MM
mesh() {
  made=$folder/$1.msh
  if [ -f "$made" ] && [ ! "$here/$2.geo" -nt "$made" ] && [ ! "$0" -nt "$made" ]; then
    return
  fi
  echo "meshing $2.geo: $made"
  gmsh -3 "$here/$2.geo" -setnumber size_mm "$3" -format msh22 -v 2 -o "$made.part"
  mv "$made.part" "$made"
}

mesh liver liver 11.6
mesh liver_fine liver 7.2
