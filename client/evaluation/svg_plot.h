// Draws a plot as SVG: axes, ticks, legend; nothing to install to look at it.
#pragma once

#include <string>
#include <vector>

#include "client/evaluation/report.h"

namespace gem::evaluation {

/// 1, 2 or 5 times a power of ten apart, at most about `count` of them, covering [low, high].
std::vector<double> Ticks(double low, double high, int count);

/// A whole SVG document, 800 x 420 pixels. Points that are not finite are left out.
std::string DrawSvg(const Plot& plot);

}  // namespace gem::evaluation
