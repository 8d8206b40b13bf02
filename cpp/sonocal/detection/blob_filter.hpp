// Bright blobs of a grey image at several scales, sub-pixel.
#pragma once

#include <utility>
#include <vector>

#include "sonocal/detection/echo_fit.hpp"

namespace sonocal {

struct Blob {
  double u, v;        // px of the image; the origin is the centre of the first pixel
  double score;       // response in units of the image's own noise at its scale, more for greater contrast
  double scale;       // standard deviation of the centre's filter, px
  double contrast;    // of the peak above its surround, grey levels
  double uu, uv, vv;  // px^2: second moments of the bright part, or of a first echo contrast / curvature
  double area;        // pixels of the bright part
  double deeper = 0;  // px below v, where a merged first echo may be as well; 0: nowhere else
};

struct BlobOptions {
  int count = 5;
  double least_score = 4;
  double least_contrast = 1;  // floor of the noise at the finest scale, grey levels: black images have none
  double level = 0.5;         // of the contrast, above which a pixel belongs to the blob
  double split = 0.3;         // of the contrast, the depth of a valley that ends the blob
  bool first_echo = false;    // the place of the first echo, without its reverberations
};

// Differences of Gaussians, normalised so that masked pixels and the image's border have no weight:
//   L_i = G(s_i) * (m I) / G(s_i) * m,    response_i = L_i - L_{i+1}
// Lindeberg, Feature detection with automatic scale selection, 1998.
// The mask's part is computed once and serves every frame. Not for use from several threads at once.
class BlobFilter {
 public:
  // mask: rows x cols, 0 where the image means nothing. scales: px, increasing; one response a neighbouring
  // pair. pool: side of the squares that are averaged before filtering.
  BlobFilter(const unsigned char* mask, int rows, int cols, std::vector<double> scales, int pool);

  std::vector<Blob> detect(const float* image, const BlobOptions& options);

  int rows() const { return rows_; }
  int cols() const { return cols_; }

 private:
  struct Peak {
    int row, col, level;
    float score;
  };

  void pool_image(const float* image);
  void blur(std::vector<float>& values, double sigma);
  void respond(double least_contrast);
  std::vector<Peak> peaks(double least_score, int most) const;
  struct Summit {
    int pixel;  // -1: all masked
    float surround, contrast;
  };
  struct Box {
    int r0, r1, c0, c1;
  };
  void grow(const float* image, int start, float threshold, float rise, const Box& box);
  void measure(const float* image, float surround, Blob& blob) const;
  Summit summit(const float* image, const Peak& peak) const;
  Box box_around(int pixel, double reach) const;
  double claim(const float* image, const Summit& top);
  Blob refine(const float* image, const Peak& peak, const Summit& top, const BlobOptions& options);
  void place_first_echo(const float* image, const Summit& top, Blob& blob);

  int rows_, cols_, pool_, small_rows_, small_cols_;
  double longest_;  // of a needle's section, px
  std::vector<double> scales_;
  std::vector<unsigned char> mask_;
  std::vector<float> weight_;                    // pooled mask, 0 to 1
  std::vector<double> steps_;                    // blur from one scale to the next, pooled px
  std::vector<std::vector<float>> normalisers_;  // 1 / G(s_i) * m; 0 where nothing is near
  std::vector<std::vector<float>> levels_;       // L_i
  std::vector<float> best_, scratch_, pooled_;   // best: greatest response / noise over the scales
  std::vector<int> best_level_;
  std::vector<std::pair<int, float>> hill_;  // pixel, lowest value on the way to it
  std::vector<EchoPixel> echo_;
  std::vector<unsigned char> seen_, taken_;  // by the hill being grown; by structures of this image
  std::vector<int> marked_;                  // where taken_ is set
};

}  // namespace sonocal
