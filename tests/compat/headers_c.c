/* SPDX-License-Identifier: Apache-2.0 */
/* The headers in C; CMakeLists.txt says in which. */
#include "header_shapes.h"

int main(int argc, char** argv) {
  if (argc > 1) {
    shape_calls(argv[1]);
  }
  return 0;
}
