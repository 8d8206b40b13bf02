# zig's own linker leaves indirect symbols behind that macOS refuses: LLVM's links, told by macos.py what it needs.
set(CMAKE_TRY_COMPILE_TARGET_TYPE STATIC_LIBRARY)
set(CMAKE_INSTALL_NAME_TOOL /bin/true)
set(CMAKE_OSX_ARCHITECTURES "${CMAKE_SYSTEM_PROCESSOR}")
set(CMAKE_CXX_CREATE_SHARED_MODULE
    "$ENV{SONOCAL_LD64} -o <TARGET> <OBJECTS> <LINK_LIBRARIES> $ENV{SONOCAL_LD64_LIBRARIES}")
