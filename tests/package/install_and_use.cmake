# SPDX-License-Identifier: Apache-2.0
function(run)
  execute_process(COMMAND ${ARGN} RESULT_VARIABLE result)
  if(NOT result EQUAL 0)
    message(FATAL_ERROR "failed (${result}): ${ARGN}")
  endif()
endfunction()

file(REMOVE_RECURSE ${WORK})
run(${CMAKE_COMMAND} --install ${BUILD} --prefix ${WORK}/prefix)
run(${CMAKE_COMMAND} -S ${SOURCE}/consumer -B ${WORK}/build -G ${GENERATOR}
    -DCMAKE_PREFIX_PATH=${WORK}/prefix -DCMAKE_BUILD_TYPE=Release)
run(${CMAKE_COMMAND} --build ${WORK}/build)
run(${WORK}/build/consumer)
run(${WORK}/build/consumer_of_0_1)
# The installed copy brings the profiles, and its program for the emulated device, by itself.
set(ENV{FORCEGRID_PROFILE_PATH} ${WORK}/prefix/share/forcegrid/profiles)
run(${WORK}/build/consumer_of_servo)
run(${CMAKE_COMMAND} -E env PATH=${WORK}/prefix/bin:$ENV{PATH} ${WORK}/build/consumer_of_device_static)
unset(ENV{FORCEGRID_PROFILE_PATH})
run(${WORK}/build/consumer_of_device)

# The same by pkg-config.
set(ENV{PKG_CONFIG_PATH} ${WORK}/prefix/lib/pkgconfig)
run(pkg-config --print-errors --exists "forcegrid >= 0.2 forcegrid < 0.3 forcegrid-link >= 0.2")
execute_process(COMMAND pkg-config --exists "forcegrid < 0.2" RESULT_VARIABLE older)
if(older EQUAL 0)
  message(FATAL_ERROR "pkg-config takes this version for one before 0.2")
endif()
execute_process(COMMAND pkg-config --cflags --libs forcegrid forcegrid-link
                OUTPUT_VARIABLE flags OUTPUT_STRIP_TRAILING_WHITESPACE COMMAND_ERROR_IS_FATAL ANY)
separate_arguments(flags UNIX_COMMAND "${flags}")
run(c++ -std=c++20 ${SOURCE}/consumer/consumer.cpp -o ${WORK}/consumer_by_pkg_config ${flags})
run(${WORK}/consumer_by_pkg_config)
execute_process(COMMAND pkg-config --cflags --libs forcegrid-device
                OUTPUT_VARIABLE flags OUTPUT_STRIP_TRAILING_WHITESPACE COMMAND_ERROR_IS_FATAL ANY)
separate_arguments(flags UNIX_COMMAND "${flags}")
run(cc ${SOURCE}/consumer/consumer_of_device.c -o ${WORK}/device_by_pkg_config ${flags}
    -Wl,-rpath,${WORK}/prefix/lib)
run(${WORK}/device_by_pkg_config)

# The shared C++ libraries, by CMake and by pkg-config. A program needs those that it asks for, and no
# other of ours; one that asks for both kinds is refused.
function(run_with_shared program)
  execute_process(COMMAND readelf -d ${program} OUTPUT_VARIABLE dynamic COMMAND_ERROR_IS_FATAL ANY)
  string(REGEX MATCHALL "libforcegrid[^]]*" needed "${dynamic}")
  list(SORT needed)
  if(NOT needed STREQUAL "${ARGN}")
    message(FATAL_ERROR "${program} needs ${needed}; expected: ${ARGN}")
  endif()
  run(${program})
endfunction()
set(configure ${CMAKE_COMMAND} -S ${SOURCE}/shared_consumer -G ${GENERATOR}
    -DCMAKE_PREFIX_PATH=${WORK}/prefix -DCMAKE_BUILD_TYPE=Release)
run(${configure} -B ${WORK}/shared)
run(${CMAKE_COMMAND} --build ${WORK}/shared)
execute_process(COMMAND ${configure} -B ${WORK}/mixed -DMIXED=ON
                RESULT_VARIABLE result OUTPUT_QUIET ERROR_VARIABLE mixed)
if(result EQUAL 0 OR NOT mixed MATCHES "FORCEGRID_LIBRARIES")
  message(FATAL_ERROR "static and shared libraries in one program are not refused: ${mixed}")
endif()
execute_process(COMMAND pkg-config --modversion forcegrid-servo-shared
                OUTPUT_VARIABLE abi OUTPUT_STRIP_TRAILING_WHITESPACE COMMAND_ERROR_IS_FATAL ANY)
string(REGEX REPLACE "[.][0-9]+$" "" abi "${abi}")
foreach(program methods session)
  set(package forcegrid-methods-shared)
  set(needed libforcegrid-methods.so.${abi})
  if(program STREQUAL "session")
    set(package forcegrid-servo-shared)
    set(needed libforcegrid-link.so.${abi} ${needed} libforcegrid-servo.so.${abi})
  endif()
  run_with_shared(${WORK}/shared/${program}_consumer ${needed})
  execute_process(COMMAND pkg-config --cflags --libs ${package}
                  OUTPUT_VARIABLE flags OUTPUT_STRIP_TRAILING_WHITESPACE COMMAND_ERROR_IS_FATAL ANY)
  separate_arguments(flags UNIX_COMMAND "${flags}")
  run(c++ -std=c++20 ${SOURCE}/shared_consumer/${program}_consumer.cpp ${flags}
      -o ${WORK}/${program}_by_pkg_config -Wl,-rpath,${WORK}/prefix/lib)
  run_with_shared(${WORK}/${program}_by_pkg_config ${needed})
endforeach()

# What else is installed.
foreach(file lib/udev/rules.d/10-forcegrid.rules share/doc/forcegrid/README.md
             share/doc/forcegrid/docs/commands.md share/doc/forcegrid/examples/spring_simulator.c
             share/man/man1/forcegrid-run.1 share/bash-completion/completions/forcegrid
             share/zsh/vendor-completions/_forcegrid share/forcegrid/scenes/small.toml)
  if(NOT EXISTS ${WORK}/prefix/${file})
    message(FATAL_ERROR "${file} is not installed")
  endif()
endforeach()

# The installed program finds its installed profiles, also without the source tree's.
run(${CMAKE_COMMAND} -E env ${WORK}/prefix/bin/forcegrid kinematics
    --profile ${WORK}/prefix/share/forcegrid/profiles/vintage.toml --counts 0,4000,9000)
# It does not look into the folder that it was built in, which may be anybody's on another machine.
file(REMOVE ${WORK}/prefix/share/forcegrid/profiles/vintage.toml)
execute_process(COMMAND ${WORK}/prefix/bin/forcegrid kinematics --profile vintage
                        --counts 0,4000,9000
                RESULT_VARIABLE result OUTPUT_QUIET ERROR_QUIET)
if(result EQUAL 0)
  message(FATAL_ERROR "the installed program takes a profile from the source tree")
endif()
