# SPDX-License-Identifier: Apache-2.0
# Writes a file for ctest with one test per test suite of a GoogleTest program, which it asks.
# cmake -DPROGRAM=FILE -DNAME=NAME -DOUT=FILE -DPROPERTIES=NAME,VALUE,... -P DiscoverSuites.cmake
execute_process(COMMAND ${PROGRAM} --gtest_list_tests OUTPUT_VARIABLE listed
                RESULT_VARIABLE failed ERROR_VARIABLE complaint)
if(failed)
  message(FATAL_ERROR "${PROGRAM} --gtest_list_tests: ${failed} ${complaint}")
endif()
# CMake separates lists by semicolons and groups them by brackets, which values of parameters have.
string(REGEX REPLACE "[];[]" "_" listed "${listed}")
string(REPLACE "\n" ";" lines "${listed}")
string(REPLACE "," " " properties "${PROPERTIES}")
set(text "")
foreach(line IN LISTS lines)
  if(NOT line MATCHES "^DISABLED_" AND line MATCHES "^([A-Za-z][A-Za-z0-9_/]*)\\.( |$)")
    set(suite "${CMAKE_MATCH_1}")
    string(APPEND text "add_test([=[${NAME}.${suite}]=] [=[${PROGRAM}]=] --gtest_filter=${suite}.*)\n"
                       "set_tests_properties([=[${NAME}.${suite}]=] PROPERTIES ${properties})\n")
  endif()
endforeach()
if(NOT text)
  message(FATAL_ERROR "${PROGRAM} --gtest_list_tests names no test suite")
endif()
file(WRITE ${OUT} "${text}")
