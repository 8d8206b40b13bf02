# Toolchain of CMake: the compiler is zig, the machine is what the environment says (scripts/wheel_targets/targets.py).
set(CMAKE_SYSTEM_NAME "$ENV{SONOCAL_SYSTEM}")
set(CMAKE_SYSTEM_PROCESSOR "$ENV{SONOCAL_PROCESSOR}")
set(CMAKE_CXX_COMPILER "$ENV{SONOCAL_ZIG}" c++ -target "$ENV{SONOCAL_ZIG_TARGET}")
set(CMAKE_AR "$ENV{SONOCAL_ZIG}")
set(CMAKE_CXX_ARCHIVE_CREATE "<CMAKE_AR> ar qc <TARGET> <OBJECTS>")
set(CMAKE_CXX_ARCHIVE_FINISH "<CMAKE_AR> ranlib <TARGET>")
# Nothing of this machine belongs into another's wheel but what Python packages brought: Eigen, nanobind.
set(CMAKE_FIND_ROOT_PATH_MODE_LIBRARY NEVER)
# nanobind 3.1 counts on its own headers to bring <cstdio>, which zig's libc++ does not.
set(CMAKE_CXX_FLAGS_INIT "-include cstdio")
