// Reads a table (its file is the argument) and, from standard input, rows "t dq1 .. dq7"; prints the
// seven torques of each.
#include <cstdio>
#include <fstream>
#include <iostream>

#include "dither.hpp"

int main(int, char** argv) {
  try {
    std::ifstream file(argv[1]);
    const auto dither = stiction::read_table<7>(file);
    double t = 0.0;
    while (std::cin >> t) {
      for (std::size_t j = 0; j < 7; ++j) {
        double dq = 0.0;
        std::cin >> dq;
        std::printf("%.17g ", dither.torque(j, t, dq));
      }
      std::printf("\n");
    }
    return 0;
  } catch (const std::exception& error) {
    std::cerr << error.what() << "\n";
    return 1;
  }
}
