# Finds the CUDA compiler, if there is one: GEM_CUDA_FOUND. Without it everything else is built all the same.
#
# What is built needs no CUDA where it runs: the run-time library is linked statically and looks for a driver itself.
option(GEM_CUDA "Build the CUDA backend where a CUDA compiler is found" ON)
set(GEM_CUDA_FOUND FALSE)
if(GEM_CUDA)
  if(NOT DEFINED ENV{CUDACXX})
    find_program(CMAKE_CUDA_COMPILER nvcc PATHS /usr/local/cuda/bin)
  endif()
  if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
    set(CMAKE_CUDA_HOST_COMPILER ${CMAKE_CXX_COMPILER})
  endif()
  include(CheckLanguage)
  check_language(CUDA)
  if(CMAKE_CUDA_COMPILER)
    # Turing to Blackwell; what is newer compiles the last for itself.
    set(CMAKE_CUDA_ARCHITECTURES "75-real;87-real;89-real;90-real;120-real;75-virtual")
    set(CMAKE_CUDA_RUNTIME_LIBRARY Static)
    if(GEM_CCACHE)
      set(CMAKE_CUDA_COMPILER_LAUNCHER ${GEM_CCACHE})
    endif()
    enable_language(CUDA)
    # CMake before 3.26 does not know that nvcc speaks C++20.
    set(CMAKE_CUDA20_STANDARD_COMPILE_OPTION "-std=c++20")
    set(CMAKE_CUDA_STANDARD 20)
    set(CMAKE_CUDA_EXTENSIONS OFF)
    find_package(CUDAToolkit REQUIRED)
    set(GEM_CUDA_FOUND TRUE)
  endif()
endif()

# The CPU and the CUDA mapper give the same numbers: no fused multiply-add. What spills registers is an error.
add_library(gem_cuda_options INTERFACE)
target_compile_options(gem_cuda_options INTERFACE
  "$<$<COMPILE_LANGUAGE:CUDA>:-fmad=false;-Xptxas=-warn-spills,-warn-lmem-usage,-Werror>"
  "$<$<COMPILE_LANGUAGE:CUDA>:-Xcompiler=-Wall,-Wextra,-ffp-contract=off>"
  "$<$<AND:$<COMPILE_LANGUAGE:CUDA>,$<BOOL:${GEM_WERROR}>>:-Werror=all-warnings>")
