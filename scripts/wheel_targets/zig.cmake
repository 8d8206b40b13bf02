# A toolchain of CMake: zig compiles, for the machine that the environment names (build.py).
set(CMAKE_SYSTEM_NAME "$ENV{SONOCAL_SYSTEM}")
set(CMAKE_SYSTEM_PROCESSOR "$ENV{SONOCAL_PROCESSOR}")
set(CMAKE_CXX_COMPILER "$ENV{SONOCAL_ZIG}" c++ -target "$ENV{SONOCAL_ZIG_TARGET}")
set(CMAKE_AR "$ENV{SONOCAL_ZIG}")
set(CMAKE_CXX_ARCHIVE_CREATE "<CMAKE_AR> ar qc <TARGET> <OBJECTS>")
set(CMAKE_CXX_ARCHIVE_FINISH "<CMAKE_AR> ranlib <TARGET>")
# nanobind 3.1 counts on the library's headers to bring <cstdio>; those of zig's libc++ do not. CPython's macros of
# POSIX's version differ from zig's, which is said once a file.
set(CMAKE_CXX_FLAGS_INIT "-include cstdio -Wno-macro-redefined")
if(APPLE OR CMAKE_SYSTEM_NAME STREQUAL "Darwin")
  include("${CMAKE_CURRENT_LIST_DIR}/macos.cmake")
endif()
