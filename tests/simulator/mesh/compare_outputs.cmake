# SPDX-License-Identifier: Apache-2.0
# Runs FIRST and SECOND and fails unless both print the same, and something.
execute_process(COMMAND ${FIRST} OUTPUT_VARIABLE first COMMAND_ERROR_IS_FATAL ANY)
execute_process(COMMAND ${SECOND} OUTPUT_VARIABLE second COMMAND_ERROR_IS_FATAL ANY)
string(LENGTH "${first}" length)
if(length LESS 1000)
  message(FATAL_ERROR "only ${length} characters were printed")
endif()
if(NOT first STREQUAL second)
  message(FATAL_ERROR "the outputs of ${FIRST} and ${SECOND} differ")
endif()
