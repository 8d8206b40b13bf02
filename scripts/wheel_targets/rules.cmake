# How CMake archives and links for the toolchain beside this; read after what it knows of the system.
set(CMAKE_CXX_ARCHIVE_CREATE "<CMAKE_AR> ar qc <TARGET> <OBJECTS>")
set(CMAKE_CXX_ARCHIVE_APPEND "<CMAKE_AR> ar q <TARGET> <OBJECTS>")
set(CMAKE_CXX_ARCHIVE_FINISH "<CMAKE_AR> ranlib <TARGET>")
# zig's own linker leaves indirect symbols behind that macOS refuses: LLVM's links, told by macos.py what it needs.
if(CMAKE_SYSTEM_NAME STREQUAL "Darwin")
  set(CMAKE_CXX_CREATE_SHARED_MODULE
      "$ENV{SONOCAL_LD64} -o <TARGET> <OBJECTS> <LINK_LIBRARIES> $ENV{SONOCAL_LD64_LIBRARIES}")
endif()
