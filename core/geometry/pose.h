// Rigid transforms and points that know their frames: T_A_C = T_A_B * T_B_C compiles, T_A_B * T_C_D
// does not.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "core/geometry/frames.h"

namespace gem {

/// A point of frame F, metres.
template <typename F>
class Point {
 public:
  Point() = default;
  Point(double x, double y, double z) : xyz_(x, y, z) {}
  explicit Point(const Eigen::Vector3d& xyz) : xyz_(xyz) {}

  double x() const { return xyz_.x(); }
  double y() const { return xyz_.y(); }
  double z() const { return xyz_.z(); }
  const Eigen::Vector3d& xyz() const { return xyz_; }

 private:
  Eigen::Vector3d xyz_ = Eigen::Vector3d::Zero();
};

/// T_To_From: maps a point of From to To. Default: identity. The rotation is kept at unit norm by
/// its makers (wire validation and products of unit quaternions).
template <typename To, typename From>
class Pose {
 public:
  Pose() = default;
  Pose(const Eigen::Quaterniond& rotation, const Eigen::Vector3d& translation)
      : rotation_(rotation), translation_(translation) {}
  static Pose FromTranslation(double x, double y, double z) {
    return {Eigen::Quaterniond::Identity(), {x, y, z}};
  }
  /// Rotation by yaw about z, then translation. Radians, metres.
  static Pose FromYaw(double yaw_rad, const Eigen::Vector3d& translation) {
    return {Eigen::Quaterniond(Eigen::AngleAxisd(yaw_rad, Eigen::Vector3d::UnitZ())), translation};
  }

  const Eigen::Quaterniond& rotation() const { return rotation_; }
  const Eigen::Vector3d& translation() const { return translation_; }
  Eigen::Matrix3d matrix() const { return rotation_.toRotationMatrix(); }

  Pose<From, To> Inverse() const {
    const Eigen::Quaterniond inverse = rotation_.conjugate();
    return {inverse, -(inverse * translation_)};
  }

 private:
  Eigen::Quaterniond rotation_ = Eigen::Quaterniond::Identity();
  Eigen::Vector3d translation_ = Eigen::Vector3d::Zero();
};

template <typename A, typename B, typename C>
Pose<A, C> operator*(const Pose<A, B>& T_A_B, const Pose<B, C>& T_B_C) {
  // Normalising keeps long chains rigid.
  return {(T_A_B.rotation() * T_B_C.rotation()).normalized(),
          T_A_B.rotation() * T_B_C.translation() + T_A_B.translation()};
}

template <typename A, typename B>
Point<A> operator*(const Pose<A, B>& T_A_B, const Point<B>& p_B) {
  return Point<A>(T_A_B.rotation() * p_B.xyz() + T_A_B.translation());
}

/// True if all coefficients are equal: q and -q differ here.
template <typename A, typename B>
bool Identical(const Pose<A, B>& a, const Pose<A, B>& b) {
  return a.rotation().coeffs() == b.rotation().coeffs() && a.translation() == b.translation();
}

/// Between T_a (fraction 0) and T_b (fraction 1): straight in translation, slerp in rotation.
template <typename A, typename B>
Pose<A, B> Interpolate(const Pose<A, B>& T_a, const Pose<A, B>& T_b, double fraction) {
  return {T_a.rotation().slerp(fraction, T_b.rotation()).normalized(),
          T_a.translation() + fraction * (T_b.translation() - T_a.translation())};
}

}  // namespace gem
