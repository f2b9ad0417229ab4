# SPDX-License-Identifier: Apache-2.0
# Prints the size of code and constants of each method: the sum of its object files' text and data.
# cmake -DSIZE_PROGRAM=size -DNAME=... -DOBJECTS=a.o;b.o -P code_size.cmake
execute_process(COMMAND ${SIZE_PROGRAM} -t ${OBJECTS}
                RESULT_VARIABLE result OUTPUT_VARIABLE output ERROR_VARIABLE error)
if(NOT result EQUAL 0 OR NOT output MATCHES "([0-9]+)[ \t]+([0-9]+)[ \t]+[0-9]+[ \t]+[0-9]+[ \t]+[0-9a-f]+[ \t]+\\(TOTALS\\)")
  message(FATAL_ERROR "${SIZE_PROGRAM} -t ${OBJECTS}: ${error}${output}")
endif()
math(EXPR bytes "${CMAKE_MATCH_1} + ${CMAKE_MATCH_2}")
math(EXPR tenths "${bytes} * 10 / 1024")
math(EXPR whole "${tenths} / 10")
math(EXPR tenth "${tenths} % 10")
message("${NAME}: ${whole}.${tenth} KB")
