# A toolchain of CMake: zig compiles, for the machine that the environment names (build.py).
set(CMAKE_SYSTEM_NAME "$ENV{SONOCAL_SYSTEM}")
set(CMAKE_SYSTEM_PROCESSOR "$ENV{SONOCAL_PROCESSOR}")
set(CMAKE_CXX_COMPILER "$ENV{SONOCAL_ZIG}" c++ -target "$ENV{SONOCAL_ZIG_TARGET}")
set(CMAKE_AR "$ENV{SONOCAL_ZIG}")
set(CMAKE_USER_MAKE_RULES_OVERRIDE "${CMAKE_CURRENT_LIST_DIR}/rules.cmake")
# nanobind 3.1 counts on the library's headers to bring <cstdio>; those of zig's libc++ do not. CPython's macros of
# POSIX's version differ from zig's, which is said once a file.
# zig writes for debuggers unless told otherwise, 50 MB a file; a section for each function lets the linker drop those
# that nobody calls.
set(CMAKE_CXX_FLAGS_INIT "-include cstdio -Wno-macro-redefined -g0 -ffunction-sections -fdata-sections")
if(CMAKE_SYSTEM_NAME STREQUAL "Windows")  # nobody else takes out what only a debugger reads, a sixth of the wheel
  set(CMAKE_MODULE_LINKER_FLAGS_INIT "-Wl,-s")
endif()
if(CMAKE_SYSTEM_NAME STREQUAL "Darwin")
  set(CMAKE_TRY_COMPILE_TARGET_TYPE STATIC_LIBRARY)
  set(CMAKE_INSTALL_NAME_TOOL /bin/true)
  set(CMAKE_OSX_ARCHITECTURES "${CMAKE_SYSTEM_PROCESSOR}")
endif()
