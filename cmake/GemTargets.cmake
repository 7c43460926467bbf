# How every target of the project is built: gem_library, gem_binary, gem_test.
set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_EXPORT_COMPILE_COMMANDS ON)
set(CMAKE_RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/bin)

if(NOT CMAKE_BUILD_TYPE)
  set(CMAKE_BUILD_TYPE Release)
endif()

find_program(GEM_CCACHE ccache)
if(GEM_CCACHE)
  set(CMAKE_CXX_COMPILER_LAUNCHER ${GEM_CCACHE})
endif()
find_program(GEM_MOLD mold)
if(GEM_MOLD AND NOT GEM_SANITIZE)
  add_link_options(-fuse-ld=mold)
endif()

# The CPU and the CUDA mapper give the same numbers: no fused multiply-add behind our back.
add_compile_options($<$<COMPILE_LANGUAGE:CXX>:-ffp-contract=off>)

add_library(gem_warnings INTERFACE)
target_compile_options(gem_warnings INTERFACE
  "$<$<COMPILE_LANGUAGE:CXX>:-Wall;-Wextra;-Wpedantic;-Wshadow;-Wnon-virtual-dtor;-Wconversion;-Wno-sign-conversion>"
  $<$<COMPILE_LANG_AND_ID:CXX,Clang>:-Wthread-safety> $<$<AND:$<COMPILE_LANGUAGE:CXX>,$<BOOL:${GEM_WERROR}>>:-Werror>)

add_library(gem_sanitize INTERFACE)
if(GEM_SANITIZE)
  target_compile_options(gem_sanitize INTERFACE -fsanitize=${GEM_SANITIZE} -fno-omit-frame-pointer -g1)
  if(GEM_SANITIZE MATCHES undefined)
    target_compile_options(gem_sanitize INTERFACE -fno-sanitize-recover=undefined)
  endif()
  add_link_options(-fsanitize=${GEM_SANITIZE})
endif()

# gem_library(NAME SOURCES... DEPENDS targets... [GRPC])
# GRPC: includes grpcpp or generated code, which ThreadSanitizer must not instrument (stock gRPC is not either).
function(gem_library name)
  cmake_parse_arguments(ARG "GRPC" "" "SOURCES;DEPENDS" ${ARGN})
  add_library(${name} STATIC ${ARG_SOURCES})
  target_include_directories(${name} PUBLIC ${PROJECT_SOURCE_DIR})
  target_link_libraries(${name} PUBLIC ${ARG_DEPENDS} PRIVATE gem_warnings)
  gem_instrument(${name} "${ARG_GRPC}")
endfunction()

function(gem_instrument name is_grpc)
  if(NOT (is_grpc AND GEM_SANITIZE MATCHES thread))
    target_link_libraries(${name} PRIVATE gem_sanitize)
  endif()
endfunction()

# gem_binary(NAME SOURCES... DEPENDS targets...)
function(gem_binary name)
  cmake_parse_arguments(ARG "" "" "SOURCES;DEPENDS" ${ARGN})
  add_executable(${name} ${ARG_SOURCES})
  target_include_directories(${name} PRIVATE ${PROJECT_SOURCE_DIR})
  target_link_libraries(${name} PRIVATE ${ARG_DEPENDS} gem_warnings gem_sanitize)
endfunction()

# gem_test(NAME SOURCES... DEPENDS targets... [GRPC]): one GoogleTest binary.
function(gem_test name)
  cmake_parse_arguments(ARG "GRPC" "" "SOURCES;DEPENDS" ${ARGN})
  add_executable(${name} ${ARG_SOURCES})
  target_include_directories(${name} PRIVATE ${PROJECT_SOURCE_DIR})
  target_link_libraries(${name} PRIVATE ${ARG_DEPENDS} GTest::gmock_main gem_warnings)
  gem_instrument(${name} "${ARG_GRPC}")
  set_target_properties(${name} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/tests)
  # The binary's whole run is one test: many short processes cost more than they tell.
  add_test(NAME ${name} COMMAND ${name})
  set_tests_properties(${name} PROPERTIES TIMEOUT 900)
endfunction()
