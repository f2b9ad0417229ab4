# SPDX-License-Identifier: Apache-2.0
# Run at build time: writes OUTPUT, a C++ source that knows the commit that SOURCE is at, and leaves it
# alone when it says so already. SOURCE that isn't the top of a git checkout has no commit.
#   cmake -DSOURCE=DIR -DOUTPUT=FILE -DTEMPLATE=FILE -DVERSION=X.Y.Z -P write_revision.cmake
foreach(needed SOURCE OUTPUT TEMPLATE VERSION)
  if(NOT DEFINED ${needed})
    message(FATAL_ERROR "write_revision.cmake needs -D${needed}=...")
  endif()
endforeach()

find_program(GIT git)
set(FORCEGRID_COMMIT "")
if(GIT)
  # A prefix means that some other project's checkout surrounds this one.
  execute_process(COMMAND ${GIT} rev-parse --show-prefix WORKING_DIRECTORY ${SOURCE}
                  OUTPUT_VARIABLE prefix OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET
                  RESULT_VARIABLE failed)
  if(NOT failed AND prefix STREQUAL "")
    execute_process(COMMAND ${GIT} rev-parse --short=12 HEAD WORKING_DIRECTORY ${SOURCE}
                    OUTPUT_VARIABLE FORCEGRID_COMMIT OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET)
    execute_process(COMMAND ${GIT} diff --quiet HEAD WORKING_DIRECTORY ${SOURCE}
                    OUTPUT_QUIET ERROR_QUIET RESULT_VARIABLE changed)
    if(FORCEGRID_COMMIT AND changed)
      string(APPEND FORCEGRID_COMMIT "-changed")
    endif()
  endif()
endif()
set(FORCEGRID_VERSION ${VERSION})
configure_file(${TEMPLATE} ${OUTPUT} @ONLY)
