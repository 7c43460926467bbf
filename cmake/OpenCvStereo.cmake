# gem_opencv_stereo: the two libraries of OpenCV that stereo matching needs. Not find_package(OpenCV): Debian puts its
# files into libopencv-dev alone, which brings all of OpenCV, VTK and MPI.
find_path(GEM_OPENCV_INCLUDE opencv2/calib3d.hpp PATH_SUFFIXES opencv4 REQUIRED)
find_library(GEM_OPENCV_CORE opencv_core REQUIRED)
find_library(GEM_OPENCV_CALIB3D opencv_calib3d REQUIRED)
add_library(gem_opencv_stereo INTERFACE)
target_include_directories(gem_opencv_stereo SYSTEM INTERFACE ${GEM_OPENCV_INCLUDE})
target_link_libraries(gem_opencv_stereo INTERFACE ${GEM_OPENCV_CALIB3D} ${GEM_OPENCV_CORE})
